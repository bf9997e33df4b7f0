//! A second process that outlives a killed one: it puts files in place once all are written, or takes them away.
//!
//! A program that is killed between two renames leaves new files beside old ones, and one that is killed earlier leaves
//! temporaries. So the first process starts a second one ([`Placer::start`] runs `texelwalk place`, which calls
//! [`serve`]) and tells it each name *before* it makes it. When the pipe ends without the mark that all is there, the
//! second removes what it was told of; after the mark it renames everything, whatever becomes of the first. If it is the
//! second that is killed, the first, which keeps the same journal, goes on by itself (`atomic`).
//!
//! The second process is in a process group of its own, and Ctrl-C at the terminal does not reach it. Signals that ask a
//! program to end, sent to everybody at once (a service manager, a batch system), it notes and goes on, since it ends
//! when the first does. It writes to no file: limits on sizes that it inherits do not matter, nor signals that are ignored.
//!
//! Standard input: [`HEADER`], then messages: `d` path (a folder about to be made), `f` path path (a temporary and its
//! target), `D` and `F` (the last folder, the last file was not made), `!` (all there). A path is its length (32 bits,
//! little endian) and its bytes, which need not be UTF-8. Standard output: `r` (ready), then `k` (all in place) or `e`,
//! the number of the file that failed, and the error of the system (32 bits each).
//!
//! Limits: a kill of both at once (a whole container) or a loss of power between two renames leaves some files new, each
//! of them whole. Unix only; elsewhere files are renamed by the process that wrote them.

use super::journal::Fault;
use super::journal::Journal;
use super::journal::MARKS;
use super::journal::Step;
use super::names::parent;
use std::ffi::OsStr;
use std::ffi::OsString;
use std::io;
use std::io::Read;
use std::io::Write;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::ffi::OsStringExt;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::path::PathBuf;
use std::process::Child;
use std::process::ChildStdin;
use std::process::ChildStdout;
use std::process::Command;
use std::process::Stdio;

/// What the input begins with; anything else is not meant for it.
const HEADER: &[u8] = b"texelwalk place 1\n";

/// Longest name that is believed [bytes]; no system has longer ones.
const LONGEST: u32 = 1 << 16;

/// The second process, seen from the first.
#[derive(Debug)]
pub(super) struct Placer {
    child: Child,
    /// Ended by dropping it.
    to: Option<ChildStdin>,
    from: ChildStdout,
}

impl Placer {
    /// Starts `program place` and waits until it listens; nothing if that cannot be.
    pub(super) fn start(program: &Path) -> Option<Self> {
        let mut command = Command::new(program);
        command.arg0("texelwalk").arg("place").process_group(0);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().ok()?;
        let (to, from) = (child.stdin.take(), child.stdout.take()?);
        let mut placer = Self { child, to, from };
        let mut answer = [0];
        let ready = placer.send(HEADER).and_then(|()| placer.from.read_exact(&mut answer));
        if ready.is_ok() && answer == *b"r" {
            return Some(placer);
        }
        // Something else runs under that name, and may never end by itself.
        let _ = placer.child.kill();
        None
    }

    /// Tells what is about to be made.
    ///
    /// # Errors
    /// If the process is gone.
    pub(super) fn tell(&mut self, step: &Step) -> io::Result<()> {
        let mut message = vec![];
        let mut path = |path: &Path| {
            let bytes = path.as_os_str().as_bytes();
            let length = u32::try_from(bytes.len()).map_err(io::Error::other)?;
            message.extend(length.to_le_bytes());
            message.extend(bytes);
            io::Result::Ok(())
        };
        let tag = match step {
            Step::Folder(folder) => path(folder).map(|()| b'd')?,
            Step::File { temporary, target } => path(temporary).and_then(|()| path(target)).map(|()| b'f')?,
        };
        message.insert(0, tag);
        self.send(&message)
    }

    /// Tells that the last folder (`d`) or file was not made.
    ///
    /// # Errors
    /// If the process is gone.
    pub(super) fn forget(&mut self, folder: bool) -> io::Result<()> {
        self.send(if folder { b"D" } else { b"F" })
    }

    /// Has everything put in place; nothing if the process ended without an answer.
    pub(super) fn place(mut self) -> Option<Result<(), Fault>> {
        self.send(b"!").ok()?;
        let mut answer = [0];
        self.from.read_exact(&mut answer).ok()?;
        if answer == *b"k" {
            return Some(Ok(()));
        }
        let [mut file, mut code] = [[0; 4]; 2];
        self.from.read_exact(&mut file).and_then(|()| self.from.read_exact(&mut code)).ok()?;
        let source = io::Error::from_raw_os_error(i32::from_le_bytes(code));
        Some(Err(Fault { file: u32::from_le_bytes(file) as usize, source }))
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        let to = self.to.as_mut().ok_or(io::ErrorKind::BrokenPipe)?;
        to.write_all(bytes).and_then(|()| to.flush())
    }
}

impl Drop for Placer {
    fn drop(&mut self) {
        drop(self.to.take());
        // Where signals of ended children are ignored there is no status, but they are waited for all the same.
        let _ = self.child.wait();
    }
}

/// The second process: does what `input` says, and nothing else.
///
/// # Errors
/// If `input` does not come from a bake, or is cut off; then what it told of is removed.
pub fn serve(mut input: impl Read, mut output: impl Write) -> io::Result<()> {
    let mut header = [0; HEADER.len()];
    input.read_exact(&mut header)?;
    if header != HEADER {
        return Err(refused("the input does not come from texelwalk"));
    }
    say(&mut output, b"r")?;
    let mut journal = Journal::default();
    loop {
        let mut tag = [0];
        input.read_exact(&mut tag)?;
        match tag[0] {
            b'd' => journal.note(Step::Folder(read_path(&mut input)?)),
            b'f' => journal.note(read_file(&mut input)?),
            b'D' => journal.forget_folder(),
            b'F' => journal.forget_file(),
            b'!' => break,
            _ => return Err(refused("a message is unknown")),
        }
    }
    let answer = match journal.finish() {
        Ok(()) => b"k".to_vec(),
        Err(Fault { file, source }) => {
            let code = source.raw_os_error().unwrap_or_default().to_le_bytes();
            [&b"e"[..], &(file as u32).to_le_bytes(), &code].concat()
        }
    };
    drop(journal);
    // The first process may be gone, and then nobody wants to know.
    let _ = say(&mut output, &answer);
    Ok(())
}

fn say(output: &mut impl Write, bytes: &[u8]) -> io::Result<()> {
    output.write_all(bytes).and_then(|()| output.flush())
}

fn refused(why: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, why)
}

fn read_path(input: &mut impl Read) -> io::Result<PathBuf> {
    let mut length = [0; 4];
    input.read_exact(&mut length)?;
    let length = u32::from_le_bytes(length);
    if length > LONGEST {
        return Err(refused("a name is too long"));
    }
    let mut bytes = vec![0; length as usize];
    input.read_exact(&mut bytes)?;
    Ok(OsString::from_vec(bytes).into())
}

/// A temporary, by its name, and a target in the same folder; nothing else is ever renamed or removed.
fn read_file(input: &mut impl Read) -> io::Result<Step> {
    let (temporary, target) = (read_path(input)?, read_path(input)?);
    let name = temporary.file_name().map(OsStr::as_bytes).unwrap_or_default();
    let [start, end] = MARKS.map(str::as_bytes);
    if !(name.starts_with(start) && name.ends_with(end) && parent(&temporary) == parent(&target)) {
        return Err(refused("it is no temporary file of texelwalk"));
    }
    Ok(Step::File { temporary, target })
}
