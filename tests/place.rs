//! The second process of a bake, which puts its files in place: told by hand up to each point, then left alone; and
//! bakes whose second process is missing, is something else, or goes away.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "tests")]

use std::fs;
use std::io::{Read, Write};
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use texelwalk::bake::{self, Observer, Request};
use texelwalk::base::Progress;
use texelwalk::output;
use texelwalk::output::File;
use texelwalk::output::atomic::commit;
use texelwalk::settings::{Options, Preset};

const PROGRAM: &str = env!("CARGO_BIN_EXE_texelwalk");
const HEADER: &[u8] = b"texelwalk place 1\n";

/// A folder with an old file, and what a bake has made beside it before the renames.
struct Half {
    root: tempfile::TempDir,
    /// Temporary and target; the first replaces a file, the last lies in a new folder.
    files: Vec<(PathBuf, PathBuf)>,
    new_folder: PathBuf,
}

impl Half {
    fn new() -> Self {
        let root = tempfile::tempdir().unwrap();
        let new_folder = root.path().join("new");
        fs::create_dir(&new_folder).unwrap();
        let odd = std::ffi::OsString::from_vec(b"od\xFF d\n.exr".to_vec());
        let targets = [root.path().join("page.exr"), root.path().join(odd), new_folder.join("room.glb")];
        fs::write(&targets[0], "old").unwrap();
        let with_temporary = |(k, target): (usize, PathBuf)| {
            let temporary = target.with_file_name(format!(".texelwalk-{k}.tmp"));
            fs::write(&temporary, "new").unwrap();
            (temporary, target)
        };
        let files = targets.into_iter().enumerate().map(with_temporary).collect();
        Self { root, files, new_folder }
    }

    /// What a bake says: header, folder, files, mark.
    fn messages(&self) -> Vec<Vec<u8>> {
        let mut all = vec![HEADER.to_vec(), message(b"d", &[&self.new_folder])];
        all.extend(self.files.iter().map(|(temporary, target)| message(b"f", &[temporary, target])));
        all.push(b"!".to_vec());
        all
    }

    fn is_old(&self) -> bool {
        names(self.root.path()) == [b"page.exr"] && fs::read(&self.files[0].1).unwrap() == b"old"
    }

    fn is_new(&self) -> bool {
        names(self.root.path()).len() == 3
            && names(&self.new_folder) == [b"room.glb"]
            && self.files.iter().all(|(_, target)| fs::read(target).unwrap() == b"new")
    }
}

fn message(tag: &[u8], paths: &[&Path]) -> Vec<u8> {
    let mut bytes = tag.to_vec();
    for path in paths {
        let path = path.as_os_str().as_bytes();
        bytes.extend(u32::try_from(path.len()).unwrap().to_le_bytes());
        bytes.extend(path);
    }
    bytes
}

fn names(folder: &Path) -> Vec<Vec<u8>> {
    let mut all: Vec<_> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_vec()).collect();
    all.sort();
    all
}

fn place() -> Child {
    let mut command = Command::new(PROGRAM);
    command.arg("place").stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Says `input` to the second process and hangs up; what it answered.
fn told(input: &[u8]) -> (ExitStatus, Vec<u8>) {
    let mut child = place();
    // It may have hung up before, where it refuses.
    let _ = child.stdin.take().unwrap().write_all(input);
    let out = child.wait_with_output().unwrap();
    (out.status, out.stdout)
}

#[test]
fn without_the_mark_everything_is_taken_away_and_with_it_everything_is_placed() {
    let half = Half::new();
    let messages = half.messages();
    let (status, answer) = told(&messages.concat());
    assert!(status.success() && answer == b"rk" && half.is_new());

    // Hung up in front of each message that is not the first ones, and in the middle of it.
    for cut in 1..messages.len() {
        for inside in [false, true] {
            let half = Half::new();
            let messages = half.messages();
            let mut input = messages[..cut].concat();
            if inside {
                input.extend(&messages[cut][..messages[cut].len() / 2]);
            }
            let (status, answer) = told(&input);
            assert_eq!((status.code(), &answer[..]), (Some(4), &b"r"[..]), "cut at {cut}");
            let known = cut.saturating_sub(2);
            for (k, (temporary, _)) in half.files.iter().enumerate() {
                assert_eq!(temporary.exists(), k >= known, "cut at {cut}: file {k}");
            }
            assert_eq!(half.is_old(), known == half.files.len(), "cut at {cut}");
            assert_eq!(fs::read(&half.files[0].1).unwrap(), b"old");
        }
    }
}

#[test]
fn a_reader_that_is_gone_and_signals_to_everybody_change_nothing() {
    let half = Half::new();
    let mut child = place();
    let mut to = child.stdin.take().unwrap();
    let messages = half.messages();
    to.write_all(&messages[0]).unwrap();
    let mut ready = [0];
    child.stdout.take().unwrap().read_exact(&mut ready).unwrap();
    assert_eq!(&ready, b"r");
    for signal in ["-INT", "-TERM", "-HUP", "-QUIT"] {
        assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
    }
    to.write_all(&messages[1..].concat()).unwrap();
    drop(to);
    assert!(child.wait().unwrap().success());
    assert!(half.is_new());
}

#[test]
fn what_no_bake_says_is_refused() {
    let root = tempfile::tempdir().unwrap();
    let [precious, other] = ["precious", "other"].map(|name| root.path().join(name));
    fs::write(&precious, "x").unwrap();
    let temporary = root.path().join("sub/.texelwalk-1.tmp");
    fs::create_dir(root.path().join("sub")).unwrap();
    fs::write(&temporary, "x").unwrap();
    let inputs = [
        b"f".repeat(100),
        vec![],
        [HEADER, b"?"].concat(),
        [HEADER, b"d\xFF\xFF\xFF\xFF/"].concat(),
        [HEADER, &message(b"f", &[&precious, &other]), b"!"].concat(),
        [HEADER, &message(b"f", &[&temporary, &other]), b"!"].concat(),
        // A folder that holds something stays.
        [HEADER, &message(b"d", &[root.path()])].concat(),
    ];
    for input in inputs {
        assert_eq!(told(&input).0.code(), Some(4), "{input:?}");
        assert!(precious.exists() && temporary.exists() && !other.exists(), "{input:?}");
    }
}

#[test]
fn a_rename_that_fails_is_reported_with_its_file() {
    let half = Half::new();
    fs::create_dir(half.root.path().join("folder")).unwrap();
    let temporary = half.root.path().join(".texelwalk-9.tmp");
    fs::write(&temporary, "new").unwrap();
    let mut messages = half.messages();
    messages.insert(5, message(b"f", &[&temporary, &half.root.path().join("folder")]));
    let (status, answer) = told(&messages.concat());
    assert!(status.success());
    let is_a_directory = 21_i32;
    assert_eq!(answer, [&b"re"[..], &3_u32.to_le_bytes(), &is_a_directory.to_le_bytes()].concat());
    assert_eq!(names(half.root.path()), [&b"folder"[..], b"page.exr"]);
}

/// A program of a few words in a shell, instead of the second process.
fn program(folder: &Path, name: &str, script: &str) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    path
}

/// What a bake says from its first word to the mark, with these files in new folders [bytes].
fn length(files: &[File]) -> usize {
    let temporary = ".texelwalk-.tmp".len() + 16;
    let one = |path: &PathBuf| {
        let (path, folder) = (path.as_os_str().len(), path.parent().unwrap().as_os_str().len());
        (1 + 4 + folder) + (1 + 4 + folder + 1 + temporary + 4 + path)
    };
    HEADER.len() + files.iter().map(|(path, _)| one(path)).sum::<usize>() + 1
}

#[test]
fn files_are_placed_whatever_becomes_of_the_second_process() {
    let tools = tempfile::tempdir().unwrap();
    let listen = "printf r; head -c \"$ALL\" >/dev/null";
    let cases = [
        ("none", None),
        ("missing", None),
        ("real", None),
        ("deaf", Some("exit 0".to_owned())),
        ("other", Some("echo usage".to_owned())),
        ("short", Some("printf r".to_owned())),
        ("killed", Some(format!("{listen}; kill -9 $$"))),
        ("killed-between-renames", Some(format!("{listen}; mv \"$OUT\"/.texelwalk-* \"$OUT/a.bin\"; kill -9 $$"))),
    ];
    for (name, script) in cases {
        let out = tools.path().join(format!("{name}-out"));
        let files = [(out.join("a.bin"), vec![1; 10].into()), (out.join("b/b.bin"), vec![2; 10].into())];
        let settings = format!("OUT={}; ALL={};", out.display(), length(&files));
        let program = match (name, script) {
            ("none", _) => None,
            ("real", _) => Some(PathBuf::from(PROGRAM)),
            (_, None) => Some(tools.path().join(name)),
            (_, Some(script)) => Some(program(tools.path(), name, &format!("{settings} {script}"))),
        };
        commit(&files, &[], program.as_deref(), &|| false).unwrap_or_else(|e| panic!("{name}: {e}"));
        for (path, bytes) in &files {
            assert!(fs::read(path).unwrap() == bytes.to_vec(), "{name}");
        }
        assert_eq!((names(&out).len(), names(&out.join("b")).len()), (2, 1), "{name}");
    }
}

#[test]
fn faults_are_the_same_with_and_without_a_second_process() {
    let said = |program: Option<&Path>, patience: u32| {
        let root = tempfile::tempdir().unwrap();
        fs::write(root.path().join("file"), "x").unwrap();
        let files = [(root.path().join("n/a.bin"), vec![1].into()), (root.path().join("file/b.bin"), vec![2].into())];
        let files = if patience > 0 { &files[..1] } else { &files[..] };
        let asked = std::cell::Cell::new(0);
        let cancelled = || asked.replace(asked.get() + 1) + 1 == patience;
        let error = commit(files, &[], program, &cancelled).unwrap_err();
        assert_eq!(names(root.path()), [b"file"]);
        error.to_string().replace(root.path().to_str().unwrap(), "")
    };
    for patience in 0..3 {
        assert_eq!(said(Some(Path::new(PROGRAM)), patience), said(None, patience));
    }
}

/// Asks to stop as soon as files are written.
struct Late(Arc<Progress>);

impl Observer for Late {
    fn stage(&self, _: &'static str, _: &Arc<Progress>) {}

    fn done(&self, name: &'static str, _: f64) {
        if name == "write" {
            self.0.cancel();
        }
    }
}

#[test]
fn whoever_asks_to_stop_after_the_files_are_in_place_is_told_that_they_are() {
    let root = tempfile::tempdir().unwrap();
    let preset = Options::from_toml("texels-per-meter = 2").unwrap();
    let settings = preset.over(Options::preset(Preset::Preview).unwrap()).settings().unwrap();
    let input = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/cornell/cornell.gltf");
    let request = Request::new(input, root.path().join("out.glb"), settings, Preset::Preview);
    let request = Request { placer: Some(PROGRAM.into()), ..request };
    let progress = Arc::new(Progress::default());
    let outcome = bake::bake(&request, &Late(Arc::clone(&progress)), Arc::clone(&progress)).unwrap();
    assert!(progress.interrupted());
    assert_eq!(names(root.path()).len(), outcome.files.len());
    assert!(outcome.files.iter().all(|(path, bytes)| path.metadata().unwrap().len() == *bytes));

    // Before that it is an interruption, and nothing is there.
    let again = Request { output: root.path().join("again/out.glb"), ..request };
    let error = bake::bake(&again, &Late(Arc::default()), progress).unwrap_err();
    assert!(matches!(error, bake::Error::Interrupted | bake::Error::Output(output::Error::Interrupted)), "{error}");
    assert!(!root.path().join("again").exists());
}
