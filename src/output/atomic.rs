//! Puts a set of files in place together.
//!
//! Every file is written in full to a temporary name in its own folder and flushed to the disk; only when all are there
//! are they renamed, in the order given. Whatever fails before the first rename leaves every folder as it was. Should a
//! rename fail after that (a folder was taken away meanwhile), the files put in place that were not there before are
//! removed again; one that replaced an older file stays, complete.
//!
//! A file that was read is never replaced, under whatever name (links, hard links, `..`) it is reached.

use super::Error;
use super::names::parent;
use std::io::Write;
use std::path::Path;
use std::path::PathBuf;
use tempfile::NamedTempFile;

/// Bytes between two looks at whether to stop.
const PIECE: usize = 8 << 20;

/// Writes all `files` (path, contents) or none. Put last what refers to the others.
///
/// `inputs` are the files that must not be touched; `cancelled` is asked now and then until the renames begin.
///
/// # Errors
/// If an output is an input, a folder, or named twice; if the file system fails; if `cancelled` says so.
pub fn commit(files: &[(PathBuf, Vec<u8>)], inputs: &[PathBuf], cancelled: &dyn Fn() -> bool) -> Result<(), Error> {
    check_targets(files, inputs)?;
    let mut folders = NewFolders::default();
    let mut written = Vec::with_capacity(files.len());
    for (path, contents) in files {
        folders.create(parent(path))?;
        written.push((path, write_temporary(path, contents, cancelled)?));
    }
    if cancelled() {
        return Err(Error::Interrupted);
    }
    // Folders that did not exist a moment ago can still turn out to be aliases of each other or of an input's.
    check_targets(files, inputs)?;
    rename_all(written)?;
    folders.keep();
    sync_folders(files);
    Ok(())
}

fn check_targets(files: &[(PathBuf, Vec<u8>)], inputs: &[PathBuf]) -> Result<(), Error> {
    for (i, (path, _)) in files.iter().enumerate() {
        if path.file_name().is_none() || path.is_dir() {
            return Err(Error::invalid(path, "is a folder; name a file"));
        }
        if let Some(input) = inputs.iter().find(|input| same_file(path, input)) {
            return Err(Error::invalid(
                path,
                format!("would overwrite the input {}; choose another output", input.display()),
            ));
        }
        if files[..i].iter().any(|(other, _)| same_file(path, other)) {
            return Err(Error::invalid(path, "two outputs have this name"));
        }
    }
    Ok(())
}

/// The two names lead to one file, or would if it existed.
fn same_file(a: &Path, b: &Path) -> bool {
    if a == b {
        return true;
    }
    if let (Ok(a), Ok(b)) = (a.canonicalize(), b.canonicalize()) {
        return a == b || same_inode(&a, &b);
    }
    let folder_of = |p: &Path| parent(p).canonicalize().ok();
    a.file_name() == b.file_name() && folder_of(a).is_some() && folder_of(a) == folder_of(b)
}

#[cfg(unix)]
fn same_inode(a: &Path, b: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    match (a.metadata(), b.metadata()) {
        (Ok(a), Ok(b)) => (a.dev(), a.ino()) == (b.dev(), b.ino()),
        _ => false,
    }
}

#[cfg(not(unix))]
fn same_inode(_: &Path, _: &Path) -> bool {
    false
}

fn write_temporary(path: &Path, contents: &[u8], cancelled: &dyn Fn() -> bool) -> Result<NamedTempFile, Error> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".texelwalk-").suffix(".tmp");
    #[cfg(unix)]
    {
        // The default of temporary files is 0600; outputs get what the user's umask leaves of 0666.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let mut file = builder.tempfile_in(parent(path)).map_err(|e| Error::io(path, "create a file in its folder", e))?;
    for piece in contents.chunks(PIECE) {
        if cancelled() {
            return Err(Error::Interrupted);
        }
        file.write_all(piece).map_err(|e| Error::io(path, "write", e))?;
    }
    file.flush().map_err(|e| Error::io(path, "write", e))?;
    file.as_file().sync_all().map_err(|e| Error::io(path, "write to the disk", e))?;
    Ok(file)
}

fn rename_all(written: Vec<(&PathBuf, NamedTempFile)>) -> Result<(), Error> {
    let mut new: Vec<&PathBuf> = Vec::new();
    for (path, file) in written {
        let existed = path.exists();
        if let Err(e) = file.persist(path) {
            for done in new {
                // The error that is reported is the one that came first.
                let _ = std::fs::remove_file(done);
            }
            return Err(Error::io(path, "put in place", e.error));
        }
        if !existed {
            new.push(path);
        }
    }
    Ok(())
}

/// Makes the renames themselves durable; not every file system can, and the files are whole either way.
fn sync_folders(files: &[(PathBuf, Vec<u8>)]) {
    let mut folders: Vec<&Path> = files.iter().map(|(path, _)| parent(path)).collect();
    folders.sort_unstable();
    folders.dedup();
    for folder in folders {
        if let Ok(folder) = std::fs::File::open(folder) {
            let _ = folder.sync_all();
        }
    }
}

/// Folders made on the way, removed again unless kept.
#[derive(Default)]
struct NewFolders {
    made: Vec<PathBuf>,
}

impl NewFolders {
    fn create(&mut self, folder: &Path) -> Result<(), Error> {
        let missing: Vec<&Path> = folder.ancestors().take_while(|p| !p.as_os_str().is_empty() && !p.exists()).collect();
        for path in missing.into_iter().rev() {
            match std::fs::create_dir(path) {
                Ok(()) => self.made.push(path.to_path_buf()),
                Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {}
                Err(e) => return Err(Error::io(path, "create the folder", e)),
            }
        }
        Ok(())
    }

    fn keep(mut self) {
        self.made.clear();
    }
}

impl Drop for NewFolders {
    fn drop(&mut self) {
        for folder in self.made.iter().rev() {
            // Someone else may have put a file there; then it stays.
            let _ = std::fs::remove_dir(folder);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    fn never() -> bool {
        false
    }

    fn names(folder: &Path) -> Vec<String> {
        let mut all: Vec<String> =
            std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        all.sort();
        all
    }

    #[test]
    fn files_and_folders_appear_and_old_files_are_replaced() {
        let root = tempfile::tempdir().unwrap();
        let (a, b) = (root.path().join("x/y/a.bin"), root.path().join("b.bin"));
        std::fs::write(&b, "old and longer").unwrap();
        commit(&[(a.clone(), b"a".to_vec()), (b.clone(), Vec::new())], &[], &never).unwrap();
        assert_eq!((std::fs::read(&a).unwrap(), std::fs::read(&b).unwrap()), (b"a".to_vec(), Vec::new()));
        assert_eq!(names(root.path()), ["b.bin", "x"]);
    }

    #[cfg(unix)]
    #[test]
    fn others_may_read_what_the_umask_lets_them() {
        use std::os::unix::fs::PermissionsExt;
        let root = tempfile::tempdir().unwrap();
        let (ours, plain) = (root.path().join("a"), root.path().join("b"));
        commit(&[(ours.clone(), vec![1])], &[], &never).unwrap();
        std::fs::write(&plain, "x").unwrap();
        assert_eq!(ours.metadata().unwrap().permissions().mode(), plain.metadata().unwrap().permissions().mode());
    }

    #[test]
    fn a_failure_leaves_nothing() {
        let root = tempfile::tempdir().unwrap();
        std::fs::write(root.path().join("file"), "x").unwrap();
        let good = (root.path().join("new/deep/a.bin"), vec![1]);
        let below_a_file = (root.path().join("file/b.bin"), vec![2]);
        assert!(matches!(commit(&[good.clone(), below_a_file], &[], &never), Err(Error::Io { .. })));
        assert_eq!(names(root.path()), ["file"]);

        std::fs::create_dir(root.path().join("folder")).unwrap();
        let a_folder = (root.path().join("folder"), vec![2]);
        assert!(matches!(commit(&[good.clone(), a_folder], &[], &never), Err(Error::Invalid { .. })));
        assert!(matches!(commit(&[good.clone(), good], &[], &never), Err(Error::Invalid { .. })));
        assert_eq!(names(root.path()), ["file", "folder"]);
    }

    #[test]
    fn an_interruption_leaves_nothing() {
        let root = tempfile::tempdir().unwrap();
        let old = root.path().join("old.bin");
        std::fs::write(&old, "old").unwrap();
        let files = [(root.path().join("n/a.bin"), vec![0; 3 * PIECE]), (old.clone(), vec![1; 10])];
        for patience in 0..5 {
            let asked = Cell::new(0);
            let cancelled = || asked.replace(asked.get() + 1) >= patience;
            assert!(matches!(commit(&files, &[], &cancelled), Err(Error::Interrupted)), "{patience}");
            assert_eq!(names(root.path()), ["old.bin"]);
            assert_eq!(std::fs::read(&old).unwrap(), b"old");
        }
    }

    #[test]
    fn inputs_are_never_replaced() {
        let root = tempfile::tempdir().unwrap();
        let input = root.path().join("in.gltf");
        std::fs::write(&input, "input").unwrap();
        let mut aliases = vec![input.clone(), root.path().join("./in.gltf")];
        std::fs::create_dir(root.path().join("sub")).unwrap();
        aliases.push(root.path().join("sub/../in.gltf"));
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(&input, root.path().join("link.gltf")).unwrap();
            std::os::unix::fs::symlink(root.path(), root.path().join("sub/up")).unwrap();
            aliases.push(root.path().join("link.gltf"));
            aliases.push(root.path().join("sub/up/in.gltf"));
        }
        std::fs::hard_link(&input, root.path().join("hard.gltf")).unwrap();
        #[cfg(unix)]
        aliases.push(root.path().join("hard.gltf"));
        for alias in aliases {
            let files = [(root.path().join("other.bin"), vec![1]), (alias.clone(), vec![2])];
            let error = commit(&files, std::slice::from_ref(&input), &never).unwrap_err();
            assert!(error.to_string().contains("would overwrite the input"), "{}: {error}", alias.display());
            assert_eq!(std::fs::read(&input).unwrap(), b"input");
            assert!(!root.path().join("other.bin").exists());
        }
    }
}
