//! Files on their way to their places: what is made for them, how they get there, how everything is taken away again.
//!
//! In: names, each noted before the file system is touched, so that nothing is ever there that no journal knows of. Out:
//! all files at their targets after [`Journal::finish`], or, where a journal is dropped before, no temporary and no new
//! folder.
//!
//! Two processes can keep a journal of the same files (`placer`): taking away what is not there does nothing, and a
//! file that somebody else has put in place is told by its [`Identity`].

use std::fs::Metadata;
use std::io;
use std::io::ErrorKind;
use std::path::Path;
use std::path::PathBuf;

use super::names::parent;

/// Names of temporary files begin and end so.
pub(super) const MARKS: [&str; 2] = [".texelwalk-", ".tmp"];

/// Which file it is, whatever its name: device and number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Identity(u64, u64);

impl Identity {
    #[cfg(unix)]
    pub(super) fn of(file: &Metadata) -> Option<Self> {
        use std::os::unix::fs::MetadataExt;
        Some(Self(file.dev(), file.ino()))
    }

    #[cfg(not(unix))]
    pub(super) fn of(_: &Metadata) -> Option<Self> {
        None
    }
}

/// What is about to be made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Step {
    Folder(PathBuf),
    /// A temporary file, and where it is to go.
    File {
        temporary: PathBuf,
        target: PathBuf,
    },
}

/// A rename that failed: which of the files, and why.
#[derive(Debug)]
pub(super) struct Fault {
    pub(super) file: usize,
    pub(super) source: io::Error,
}

/// What was made so far.
#[derive(Debug, Default)]
pub(super) struct Journal {
    folders: Vec<PathBuf>,
    files: Vec<File>,
}

#[derive(Debug)]
struct File {
    temporary: PathBuf,
    target: PathBuf,
    identity: Option<Identity>,
}

impl Journal {
    pub(super) fn note(&mut self, step: Step) {
        match step {
            Step::Folder(path) => self.folders.push(path),
            Step::File { temporary, target } => self.files.push(File { temporary, target, identity: None }),
        }
    }

    /// The last folder was not made: it is somebody else's, or cannot be made.
    pub(super) fn forget_folder(&mut self) {
        self.folders.pop();
    }

    /// The last temporary was not made.
    pub(super) fn forget_file(&mut self) {
        self.files.pop();
    }

    /// Says which file the last temporary is.
    pub(super) fn identify(&mut self, identity: Option<Identity>) {
        if let Some(file) = self.files.last_mut() {
            file.identity = identity;
        }
    }

    /// Where the file goes that a [`Fault`] is about.
    pub(super) fn target(&self, file: usize) -> &Path {
        self.files.get(file).map_or(Path::new(""), |f| &f.target)
    }

    /// Puts all files in place, in order.
    ///
    /// # Errors
    /// If a rename fails. Then those put in place that were not there before are removed again; one that replaced an
    /// older file stays.
    pub(super) fn finish(&mut self) -> Result<(), Fault> {
        let mut new: Vec<&Path> = Vec::new();
        for (index, file) in self.files.iter().enumerate() {
            let existed = file.target.exists();
            if let Err(source) = file.put_in_place() {
                for done in new {
                    // The error that is reported is the one that came first.
                    let _ = std::fs::remove_file(done);
                }
                return Err(Fault { file: index, source });
            }
            if !existed {
                new.push(&file.target);
            }
        }
        self.sync_folders();
        self.keep();
        Ok(())
    }

    /// Everything is where it should be, and stays.
    pub(super) fn keep(&mut self) {
        self.files.clear();
        self.folders.clear();
    }

    /// Makes the renames themselves durable; not every file system can, and the files are whole either way.
    fn sync_folders(&self) {
        let mut folders: Vec<&Path> = self.files.iter().map(|f| parent(&f.target)).collect();
        folders.sort_unstable();
        folders.dedup();
        for folder in folders {
            if let Ok(folder) = std::fs::File::open(folder) {
                let _ = folder.sync_all();
            }
        }
    }
}

impl File {
    fn put_in_place(&self) -> io::Result<()> {
        match std::fs::rename(&self.temporary, &self.target) {
            Err(e) if e.kind() == ErrorKind::NotFound && self.is_in_place() => Ok(()),
            result => result,
        }
    }

    /// Another process renamed it.
    fn is_in_place(&self) -> bool {
        let there = self.target.symlink_metadata().ok().as_ref().and_then(Identity::of);
        there.is_some() && there == self.identity
    }
}

impl Drop for Journal {
    fn drop(&mut self) {
        for file in &self.files {
            // It may be in place, or never have been made.
            let _ = std::fs::remove_file(&file.temporary);
        }
        for folder in self.folders.iter().rev() {
            // Someone else may have put a file there; then it stays.
            let _ = std::fs::remove_dir(folder);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn noted(folder: &Path, names: &[&str]) -> Journal {
        let mut journal = Journal::default();
        for name in names {
            let (temporary, target) = (folder.join(format!("{name}.new")), folder.join(name));
            journal.note(Step::File { temporary: temporary.clone(), target });
            fs::write(&temporary, "new").unwrap();
            journal.identify(Identity::of(&temporary.metadata().unwrap()));
        }
        journal
    }

    fn names(folder: &Path) -> Vec<String> {
        let mut all: Vec<String> =
            fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        all.sort();
        all
    }

    #[test]
    fn a_rename_that_fails_takes_new_files_back() {
        let root = tempfile::tempdir().unwrap();
        fs::write(root.path().join("b"), "old").unwrap();
        fs::create_dir(root.path().join("c")).unwrap();
        let mut journal = noted(root.path(), &["a", "b", "c", "d"]);
        assert_eq!(journal.finish().unwrap_err().file, 2);
        drop(journal);
        assert_eq!(names(root.path()), ["b", "c"]);
        assert_eq!(fs::read(root.path().join("b")).unwrap(), b"new");
    }

    #[cfg(unix)]
    #[test]
    fn what_another_process_began_is_finished_but_what_is_lost_is_a_fault() {
        let root = tempfile::tempdir().unwrap();
        let mut journal = noted(root.path(), &["a", "b"]);
        fs::rename(root.path().join("a.new"), root.path().join("a")).unwrap();
        journal.finish().unwrap();
        assert_eq!(names(root.path()), ["a", "b"]);

        let mut journal = noted(root.path(), &["a", "b"]);
        fs::remove_file(root.path().join("a.new")).unwrap();
        assert_eq!(journal.finish().unwrap_err().source.kind(), ErrorKind::NotFound);
        drop(journal);
        assert_eq!(names(root.path()), ["a", "b"]);
    }
}
