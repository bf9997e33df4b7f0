//! Whether files may be put where they are asked for, before any work is done for them.
//!
//! In: the files that will be written, and those that are read. Out: nothing, or why not, for the first that cannot be.
//! Refused are:
//! * what is there and is no regular file, after links: a folder, a device, a pipe, a socket. Files are put in place by
//!   renaming others, which would replace it;
//! * a file that is read, under whatever name (links, hard links, `..`), one that is named twice, and one that is the folder of
//!   another;
//! * what lies below a file, or in a folder where nothing can be made. That is tried with a file without a name.
//!
//! A link stays: [`followed`] is where it leads, which may be missing.
//!
//! Limits: what happens meanwhile is not foreseen, so [`super::atomic::commit`] asks again.

use super::Error;
use super::names::parent;
use std::collections::BTreeMap;
use std::collections::BTreeSet;
use std::fs::Metadata;
use std::io;
use std::io::ErrorKind;
use std::path::Path;
use std::path::PathBuf;

/// Links that may follow each other, as on Linux.
const MOST_LINKS: usize = 40;

/// Checks all `files` that will be written together; `inputs` are those that must stay.
///
/// # Errors
/// If one of them cannot be written, or must not be.
pub fn check(files: &[&Path], inputs: &[PathBuf]) -> Result<(), Error> {
    let mut read = BTreeMap::new();
    for input in inputs {
        read.extend(keys(input).into_iter().map(|key| (key, input)));
    }
    let mut named = BTreeSet::new();
    for path in files {
        check_kind(path)?;
        let keys = keys(path);
        if let Some(input) = keys.iter().find_map(|key| read.get(key)) {
            let message = format!("would overwrite the input {}; choose another output", input.display());
            return Err(Error::invalid(path, message));
        }
        if keys.iter().any(|key| named.contains(key)) {
            return Err(Error::invalid(path, "two outputs have this name"));
        }
        named.extend(keys);
    }
    files.iter().try_for_each(|path| check_above(path, &named))
}

/// None of what is `named` is a folder that `path` lies in.
fn check_above(path: &Path, named: &BTreeSet<Key>) -> Result<(), Error> {
    let is_named = |folder: &&Path| keys(folder).iter().any(|key| named.contains(key));
    let Some(folder) = path.ancestors().skip(1).take_while(|f| !f.as_os_str().is_empty()).find(is_named) else {
        return Ok(());
    };
    let message = format!("is the folder of another output, {}; name a file", path.display());
    Err(Error::invalid(folder, message))
}

/// Checks that files can be made in the folders of all `files`, which may still be missing.
///
/// # Errors
/// If one of them lies below a file, or nothing can be made there.
pub fn check_folders(files: &[&Path]) -> Result<(), Error> {
    let folders = files.iter().map(|path| Ok(parent(&followed(path)?).to_path_buf()));
    folders.collect::<Result<BTreeSet<_>, Error>>()?.iter().try_for_each(|folder| check_folder(folder))
}

/// Checks that files can be made in a folder, which may still be missing.
///
/// # Errors
/// If it is or lies below a file, or nothing can be made there.
pub fn check_folder(folder: &Path) -> Result<(), Error> {
    let named = folder.ancestors().map(|f| if f.as_os_str().is_empty() { Path::new(".") } else { f });
    for existing in named {
        match existing.metadata() {
            Ok(found) if found.is_dir() => {
                let made = tempfile::tempfile_in(existing);
                return made.map(drop).map_err(|e| Error::io(folder, "create files in the folder", e));
            }
            Ok(_) => return Err(Error::io(folder, "create the folder", ErrorKind::NotADirectory.into())),
            Err(e) if e.kind() == ErrorKind::NotFound || e.kind() == ErrorKind::NotADirectory => {}
            Err(e) => return Err(Error::io(folder, "look for the folder", e)),
        }
    }
    Ok(())
}

/// What is there can be replaced by a file.
fn check_kind(path: &Path) -> Result<(), Error> {
    let refused = |what: &str| Err(Error::Target { path: path.to_path_buf(), message: format!("is {what}") });
    if path.file_name().is_none() {
        return refused("a folder; name a file");
    }
    match path.metadata() {
        Ok(found) if found.is_file() => Ok(()),
        Ok(found) if found.is_dir() => refused("a folder; name a file"),
        Ok(found) => refused(&format!("{}, which a file would replace; name a file", kind(&found))),
        Err(e) if e.kind() == ErrorKind::NotFound || e.kind() == ErrorKind::NotADirectory => Ok(()),
        Err(e) => Err(Error::io(path, "look for the file", e)),
    }
}

#[cfg(unix)]
fn kind(found: &Metadata) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    let kind = found.file_type();
    if kind.is_fifo() {
        "a pipe"
    } else if kind.is_socket() {
        "a socket"
    } else {
        "a device"
    }
}

#[cfg(not(unix))]
fn kind(_: &Metadata) -> &'static str {
    "no regular file"
}

/// Where links lead that `path` itself may be; what is there need not exist.
///
/// # Errors
/// If a link cannot be read, or there is no end of them.
pub fn followed(path: &Path) -> Result<PathBuf, Error> {
    let mut at = path.to_path_buf();
    for _ in 0..=MOST_LINKS {
        let is_link = at.symlink_metadata().is_ok_and(|found| found.is_symlink());
        if !is_link {
            return Ok(at);
        }
        let next = at.read_link().map_err(|e| Error::io(path, "follow the link", e))?;
        at = parent(&at).join(next);
    }
    Err(Error::io(path, "follow the link", io::Error::other("too many links follow each other")))
}

/// What two names have in common if they lead to one file, or would if it existed.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Key {
    /// Where it is.
    Place(PathBuf),
    /// Device and number, which hard links share.
    Number(u64, u64),
}

fn keys(path: &Path) -> Vec<Key> {
    if let Ok(found) = path.canonicalize() {
        let number = number(&found);
        return core::iter::once(Key::Place(found)).chain(number).collect();
    }
    let target = followed(path).unwrap_or_else(|_| path.to_path_buf());
    let folder = parent(&target).canonicalize().ok();
    let place = folder.zip(target.file_name()).map(|(folder, name)| folder.join(name));
    let place = place.or_else(|| std::path::absolute(&target).ok());
    vec![Key::Place(place.unwrap_or(target))]
}

#[cfg(unix)]
fn number(path: &Path) -> Option<Key> {
    use std::os::unix::fs::MetadataExt;
    path.metadata().ok().map(|found| Key::Number(found.dev(), found.ino()))
}

#[cfg(not(unix))]
fn number(_: &Path) -> Option<Key> {
    None
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn links_are_followed_to_what_may_be_missing() {
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        std::fs::create_dir_all(at("far/away")).unwrap();
        symlink("far/away", at("folder")).unwrap();
        symlink("../beside", at("far/away/link")).unwrap();
        symlink(at("folder/link"), at("first")).unwrap();
        let end = followed(&at("first")).unwrap();
        std::fs::write(at("far/beside"), "x").unwrap();
        assert_eq!(std::fs::read(&end).unwrap(), b"x");
        for _ in 0..2 {
            assert!(matches!(check(&[&at("first"), &at("far/beside")], &[]), Err(Error::Invalid { .. })));
            let _ = std::fs::remove_file(at("far/beside"));
        }

        symlink("b", at("a")).unwrap();
        symlink("a", at("b")).unwrap();
        for refused in [check(&[&at("a")], &[]), check_folders(&[&at("a")]), check_folder(&at("a"))] {
            assert!(matches!(refused, Err(Error::Io { .. })), "{refused:?}");
        }
    }

    #[test]
    fn folders_may_be_missing_but_not_below_a_file() {
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        std::fs::write(at("file"), "x").unwrap();
        check_folders(&[&at("new/deep/a"), &at("b")]).unwrap();
        check(&[&at("new/deep/a"), &at("file")], &[]).unwrap();
        let above = check(&[&at("new"), &at("new/deep/a")], &[]).unwrap_err().to_string();
        assert!(above.contains("new: is the folder of another output"), "{above}");
        for below in ["file/a", "file/new/a"] {
            assert!(matches!(check_folders(&[&at(below)]), Err(Error::Io { .. })), "{below}");
        }
        assert!(matches!(check(&[root.path()], &[]), Err(Error::Target { .. })));
        assert_eq!(std::fs::read_dir(root.path()).unwrap().count(), 1, "nothing was made");
    }
}
