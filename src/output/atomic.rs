//! Puts a set of files in place together.
//!
//! Every file is written in full to a temporary name in its own folder and flushed to the disk; only when all are there
//! are they renamed, in the order given. Whatever fails before the first rename leaves every folder as it was. Should a
//! rename fail after that (a folder was taken away meanwhile), the files put in place that were not there before are
//! removed again; one that replaced an older file stays, complete.
//!
//! With a second process (`placer`) that holds even if this one is killed at any moment. Without, because nobody names
//! the program or it does not start, a kill leaves temporaries or, between two renames, new files beside old ones.
//!
//! What [`targets`] refuses is never replaced. Files go where links lead that have their names; the links stay.

use super::Contents;
use super::Error;
use super::File as Output;
use super::journal::Identity;
use super::journal::Journal;
use super::journal::MARKS;
use super::journal::Step;
use super::names::parent;
#[cfg(unix)]
use super::placer::Placer;
use super::targets;
use std::fs::File;
use std::io::ErrorKind;
use std::io::Write;
use std::path::Path;
use std::path::PathBuf;

/// Bytes between two looks at whether to stop.
const PIECE: usize = 8 << 20;

/// Letters and digits in the name of a temporary file. It is noted as ours before it is made, so that it must not be the
/// name of anything else, not even by chance: 62¹⁶ is 5e28.
const RANDOM_LETTERS: usize = 16;

/// Writes all `files` (path, contents) or none. Put last what refers to the others.
///
/// `inputs` are the files that must not be touched; `placer` is texelwalk's own program, which then renames the files even
/// if this process is killed; `cancelled` is asked now and then until the renames begin.
///
/// # Errors
/// If an output is an input, is there and no regular file, or is named twice; if the file system fails; if `cancelled` says so.
pub fn commit(
    files: &[Output],
    inputs: &[PathBuf],
    placer: Option<&Path>,
    cancelled: &dyn Fn() -> bool,
) -> Result<(), Error> {
    let paths: Vec<&Path> = files.iter().map(|(path, _)| path.as_path()).collect();
    targets::check(&paths, inputs)?;
    if files.is_empty() {
        return Ok(());
    }
    let mut hands = Hands::new(placer);
    for (path, contents) in files {
        let path = targets::followed(path)?;
        hands.create_folder(parent(&path))?;
        hands.write(&path, contents, cancelled)?;
    }
    if cancelled() {
        return Err(Error::Interrupted);
    }
    // Folders that did not exist a moment ago can still turn out to be aliases of each other or of an input's.
    targets::check(&paths, inputs)?;
    hands.finish()
}

/// What is on its way to the disk, known here and to the second process, if there is one.
#[derive(Default)]
struct Hands {
    // Dropped before the journal: the second process takes everything away and ends, and then there is nothing left to
    // take away here, unless it was killed.
    placer: Option<Placer>,
    journal: Journal,
}

impl Hands {
    fn new(program: Option<&Path>) -> Self {
        Self { placer: program.and_then(Placer::start), journal: Journal::default() }
    }

    /// To be called before it is made.
    fn note(&mut self, step: Step) {
        self.placer.take_if(|placer| placer.tell(&step).is_err());
        self.journal.note(step);
    }

    fn forget(&mut self, folder: bool) {
        self.placer.take_if(|placer| placer.forget(folder).is_err());
        if folder { self.journal.forget_folder() } else { self.journal.forget_file() }
    }

    fn create_folder(&mut self, folder: &Path) -> Result<(), Error> {
        let missing: Vec<&Path> = folder.ancestors().take_while(|p| !p.as_os_str().is_empty() && !p.exists()).collect();
        for path in missing.into_iter().rev() {
            self.note(Step::Folder(path.to_path_buf()));
            if let Err(e) = std::fs::create_dir(path) {
                self.forget(true);
                if e.kind() != ErrorKind::AlreadyExists {
                    return Err(Error::io(path, "create the folder", e));
                }
            }
        }
        Ok(())
    }

    fn write(&mut self, path: &Path, contents: &Contents, cancelled: &dyn Fn() -> bool) -> Result<(), Error> {
        let mut file = self.create_temporary(path).map_err(|e| Error::io(path, "create a file in its folder", e))?;
        for piece in contents.pieces() {
            for part in piece.chunks(PIECE) {
                if cancelled() {
                    return Err(Error::Interrupted);
                }
                file.write_all(part).map_err(|e| Error::io(path, "write", e))?;
            }
        }
        file.flush().map_err(|e| Error::io(path, "write", e))?;
        file.sync_all().map_err(|e| Error::io(path, "write to the disk", e))?;
        self.journal.identify(file.metadata().ok().as_ref().and_then(Identity::of));
        Ok(())
    }

    /// A new file beside `path`, with the permissions that the user's umask leaves.
    fn create_temporary(&mut self, path: &Path) -> std::io::Result<File> {
        let [start, end] = MARKS;
        let mut builder = tempfile::Builder::new();
        let builder = builder.prefix(start).suffix(end).rand_bytes(RANDOM_LETTERS);
        let named = builder.make_in(parent(path), |proposed| {
            // It is absolute even where `path` is not.
            let temporary = path.with_file_name(proposed.file_name().unwrap_or_default());
            self.note(Step::File { temporary: temporary.clone(), target: path.to_path_buf() });
            File::create_new(temporary).inspect_err(|_| self.forget(false))
        })?;
        // The journal removes it.
        named.keep().map(|(file, _)| file).map_err(|e| e.error)
    }

    /// Has the second process put everything in place; does it itself if there is none, or if it is gone.
    fn finish(mut self) -> Result<(), Error> {
        let answer = self.placer.take().and_then(Placer::place);
        let result = answer.unwrap_or_else(|| self.journal.finish());
        result.map_err(|fault| Error::io(self.journal.target(fault.file), "put in place", fault.source))?;
        self.journal.keep();
        Ok(())
    }
}

/// Where there are no process groups, files are renamed by the process that wrote them.
#[cfg(not(unix))]
enum Placer {}

#[cfg(not(unix))]
impl Placer {
    fn start(_: &Path) -> Option<Self> {
        None
    }

    fn tell(&mut self, _: &Step) -> std::io::Result<()> {
        match *self {}
    }

    fn forget(&mut self, _: bool) -> std::io::Result<()> {
        match *self {}
    }

    fn place(self) -> Option<Result<(), super::journal::Fault>> {
        match self {}
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
        commit(&[(a.clone(), b"a".to_vec().into()), (b.clone(), Contents::default())], &[], None, &never).unwrap();
        assert_eq!((std::fs::read(&a).unwrap(), std::fs::read(&b).unwrap()), (b"a".to_vec(), Vec::new()));
        assert_eq!(names(root.path()), ["b.bin", "x"]);
    }

    #[cfg(unix)]
    #[test]
    fn others_may_read_what_the_umask_lets_them() {
        use std::os::unix::fs::PermissionsExt;
        let root = tempfile::tempdir().unwrap();
        let (ours, plain) = (root.path().join("a"), root.path().join("b"));
        commit(&[(ours.clone(), vec![1].into())], &[], None, &never).unwrap();
        std::fs::write(&plain, "x").unwrap();
        assert_eq!(ours.metadata().unwrap().permissions().mode(), plain.metadata().unwrap().permissions().mode());
    }

    #[cfg(unix)]
    #[test]
    fn links_stay_and_pipes_are_no_files() {
        use std::os::unix::fs::FileTypeExt;
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        std::fs::create_dir(at("far")).unwrap();
        std::fs::write(at("far/old"), "old").unwrap();
        for (link, target) in [("a", "far/old"), ("b", "far/new/missing")] {
            std::os::unix::fs::symlink(target, at(link)).unwrap();
            commit(&[(at(link), b"new".to_vec().into())], &[], None, &never).unwrap();
            assert_eq!(std::fs::read(at(target)).unwrap(), b"new");
            assert_eq!(at(link).read_link().unwrap(), Path::new(target));
        }
        assert_eq!(names(&at("far")), ["new", "old"]);

        let made = std::process::Command::new("mkfifo").arg(at("pipe")).status();
        assert!(made.expect("this test needs mkfifo").success());
        std::os::unix::fs::symlink("pipe", at("to-pipe")).unwrap();
        for name in ["pipe", "to-pipe"] {
            let error = commit(&[(at(name), vec![1].into())], &[], None, &never).unwrap_err();
            assert!(matches!(error, Error::Target { .. }) && error.to_string().contains("is a pipe"), "{error}");
            assert!(at(name).metadata().unwrap().file_type().is_fifo());
        }
        assert_eq!(names(root.path()), ["a", "b", "far", "pipe", "to-pipe"]);
    }

    #[test]
    fn a_failure_leaves_nothing() {
        let root = tempfile::tempdir().unwrap();
        std::fs::write(root.path().join("file"), "x").unwrap();
        let good = (root.path().join("new/deep/a.bin"), vec![1].into());
        let below_a_file = (root.path().join("file/b.bin"), vec![2].into());
        assert!(matches!(commit(&[good.clone(), below_a_file], &[], None, &never), Err(Error::Io { .. })));
        assert_eq!(names(root.path()), ["file"]);

        std::fs::create_dir(root.path().join("folder")).unwrap();
        let a_folder = (root.path().join("folder"), vec![2].into());
        assert!(matches!(commit(&[good.clone(), a_folder], &[], None, &never), Err(Error::Target { .. })));
        assert!(matches!(commit(&[good.clone(), good], &[], None, &never), Err(Error::Invalid { .. })));
        assert_eq!(names(root.path()), ["file", "folder"]);
    }

    #[test]
    fn an_interruption_leaves_nothing() {
        let root = tempfile::tempdir().unwrap();
        let old = root.path().join("old.bin");
        std::fs::write(&old, "old").unwrap();
        let files = [(root.path().join("n/a.bin"), vec![0; 3 * PIECE].into()), (old.clone(), vec![1; 10].into())];
        for patience in 0..5 {
            let asked = Cell::new(0);
            let cancelled = || asked.replace(asked.get() + 1) >= patience;
            assert!(matches!(commit(&files, &[], None, &cancelled), Err(Error::Interrupted)), "{patience}");
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
            let files = [(root.path().join("other.bin"), vec![1].into()), (alias.clone(), vec![2].into())];
            let error = commit(&files, std::slice::from_ref(&input), None, &never).unwrap_err();
            assert!(error.to_string().contains("would overwrite the input"), "{}: {error}", alias.display());
            assert_eq!(std::fs::read(&input).unwrap(), b"input");
            assert!(!root.path().join("other.bin").exists());
        }
    }
}
