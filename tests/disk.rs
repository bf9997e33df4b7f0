//! What a bake leaves on the disk when the disk refuses, or somebody stops it: what was there, or what is new, whole.
#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests")]

#[path = "support/mutate.rs"]
#[allow(dead_code, reason = "only its random numbers are used")]
mod mutate;

use mutate::Random;
use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

const PROGRAM: &str = env!("CARGO_BIN_EXE_texelwalk");
/// What a bake of it takes at most, however busy the machine is.
const PATIENCE: Duration = Duration::from_secs(60);

/// Bytes by name.
type Files = BTreeMap<String, Vec<u8>>;

/// A bake of cornell in `folder`, as the words of a shell command after `prefix`.
fn bake(prefix: &str, folder: &Path, seed: u32) -> Command {
    let input = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/cornell/cornell.gltf");
    let script = format!(
        "{prefix} exec \"{PROGRAM}\" bake \"$IN\" -o \"$OUT/out.glb\" --preset preview --texels-per-meter 4 --seed {seed} \
         --aov direct --format exr,hdr,png -q"
    );
    let mut command = Command::new("sh");
    command.arg("-c").arg(script).env("IN", input).env("OUT", folder).stdin(Stdio::null()).stderr(Stdio::piped());
    command
}

fn files(folder: &Path) -> Files {
    let entries = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    entries.map(|p| (p.file_name().unwrap().to_string_lossy().into_owned(), fs::read(p).unwrap())).collect()
}

/// Outputs of seed 1 in a new folder, and what those of seed 2 are.
fn old_and_new() -> (tempfile::TempDir, Files, Files) {
    let [old, new] = [1, 2].map(|seed| {
        let folder = tempfile::tempdir().unwrap();
        assert!(bake("", folder.path(), seed).status().unwrap().success());
        folder
    });
    let [a, b] = [files(old.path()), files(new.path())];
    assert!(a.len() >= 5 && a.keys().eq(b.keys()) && a["out.lightmap0.exr"] != b["out.lightmap0.exr"]);
    (old, a, b)
}

fn wait(mut child: Child) -> ExitStatus {
    let start = Instant::now();
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return status;
        }
        assert!(start.elapsed() < PATIENCE, "it does not end");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_disk_that_is_full_is_code_4_and_leaves_what_was_there() {
    let (folder, old, _) = old_and_new();
    // A limit on the size of files is what a full disk looks like to a program that ignores the signal.
    for blocks in [0, 2, 8] {
        let out = bake(&format!("trap '' XFSZ; ulimit -f {blocks};"), folder.path(), 2).output().unwrap();
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(4), "{blocks} blocks: {said}");
        assert_eq!(said.lines().count(), 1, "{said}");
        assert!(said.contains("out") && said.contains("File too large"), "{said}");
        assert!(files(folder.path()) == old, "{blocks} blocks: {:?}", files(folder.path()).keys());
    }
}

#[test]
fn an_interrupt_ends_any_command_with_code_130() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("in.exr");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let (input, picture) = (pipe.to_str().unwrap(), folder.path().join("view.png"));
    let commands: [&[&str]; 4] = [
        &["render", input, "-o", picture.to_str().unwrap()],
        &["check", input, "--pictures", folder.path().to_str().unwrap()],
        &["inspect", input],
        &["compare", input, input],
    ];
    for words in commands {
        let mut command = Command::new(PROGRAM);
        let child = command.args(words).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
        let child = child.unwrap();
        // Opens once the command reads; it then waits for bytes that do not come.
        let writer = fs::OpenOptions::new().write(true).open(&pipe).unwrap();
        assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
        let out = child.wait_with_output().unwrap();
        drop(writer);
        assert_eq!(out.status.code(), Some(130), "{words:?}");
        assert_eq!(String::from_utf8_lossy(&out.stderr), "error: interrupted; nothing was written\n", "{words:?}");
        assert!(out.stdout.is_empty());
        assert_eq!(files_named(folder.path()), ["in.exr"], "{words:?}");
    }
}

fn files_named(folder: &Path) -> Vec<String> {
    fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn folders_that_cannot_be_written_to_are_code_4() {
    let folder = tempfile::tempdir().unwrap();
    let locked = folder.path().join("locked");
    fs::create_dir(&locked).unwrap();
    fs::set_permissions(&locked, fs::Permissions::from_mode(0o555)).unwrap();
    // Nobody can make files in /proc, not even those who may write everywhere.
    let mut places = vec![Path::new("/proc").to_path_buf(), Path::new("/proc/new").to_path_buf()];
    let everywhere = fs::write(locked.join("probe"), "x").is_ok();
    if !everywhere {
        places.extend([locked.clone(), locked.join("new")]);
    }
    for place in places {
        let out = bake("", &place, 1).output().unwrap();
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(4), "{}: {said}", place.display());
        assert_eq!(said.lines().count(), 1, "{said}");
        assert!(said.contains(&*place.to_string_lossy()), "{said}");
    }
    assert_eq!(files(&locked).len(), usize::from(everywhere));
}

/// Exit code and standard error of the program with these words, run in a folder.
fn run(folder: &Path, words: &[&str]) -> (Option<i32>, String) {
    let out = Command::new(PROGRAM).args(words).current_dir(folder).stdin(Stdio::null()).output().unwrap();
    (out.status.code(), String::from_utf8_lossy(&out.stderr).into_owned())
}

#[test]
fn outputs_that_cannot_be_are_refused_before_anything_is_read() {
    let home = tempfile::tempdir().unwrap();
    let at = |name: &str| home.path().join(name);
    for pipe in ["pipe", "pipe.glb", "pipe.png", "pipe.usda", "a.lightmap0.exr"] {
        assert!(Command::new("mkfifo").arg(at(pipe)).status().unwrap().success());
    }
    std::os::unix::fs::symlink("pipe", at("link")).unwrap();
    fs::create_dir(at("folder")).unwrap();
    // It would be told of, if it were read.
    for file in ["in.glb", "file", "c.toml"] {
        fs::write(at(file), "").unwrap();
    }
    let before = files_named(home.path()).len();
    let bake = ["bake", "in.glb", "-o"];
    let mut cases: Vec<(Vec<&str>, i32, &str)> = vec![
        ([&bake[..], &["pipe.glb"]].concat(), 4, "pipe.glb: is a pipe"),
        ([&bake[..], &["link"]].concat(), 4, "link: is a pipe"),
        ([&bake[..], &["a.glb"]].concat(), 4, "a.lightmap0.exr: is a pipe"),
        ([&bake[..], &["file/"]].concat(), 4, "cannot create the folder"),
        ([&bake[..], &["new/b.glb", "--usd", "pipe.usda"]].concat(), 4, "pipe.usda: is a pipe"),
        ([&bake[..], &["new/b.glb", "--report", "new/b.lightmap0.png"]].concat(), 3, "two outputs have this name"),
        ([&bake[..], &["new/b.glb", "--config", "c.toml", "--html", "c.toml"]].concat(), 3, "the input c.toml"),
        (vec!["render", "in.glb", "-o", "pipe.png"], 4, "pipe.png: is a pipe"),
        (vec!["check", "in.glb", "--json", "link"], 4, "link: is a pipe"),
        (vec!["check", "in.glb", "--json", "in.glb"], 3, "would overwrite the input"),
        (vec!["check", "in.glb", "--pictures", "file"], 4, "cannot create the folder"),
    ];
    for option in ["--report", "--html", "--depfile"] {
        for (name, message) in [
            ("link", "link: is a pipe"),
            ("folder", "folder: is a folder"),
            ("file/a", "file: cannot create the folder"),
            ("/proc/a", "/proc: cannot create files"),
        ] {
            cases.push(([&bake[..], &["new/b.glb", option, name]].concat(), 4, message));
        }
    }
    for (words, code, message) in cases {
        let (ended, said) = run(home.path(), &words);
        assert!(ended == Some(code) && said.contains(message), "{words:?}: {ended:?} {said}");
        assert_eq!(said.lines().count(), 1, "{words:?}: {said}");
        assert_eq!(files_named(home.path()).len(), before, "{words:?}");
    }
}

#[test]
fn names_that_the_document_tells_are_checked_before_light_is_solved() {
    let home = tempfile::tempdir().unwrap();
    let input = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/cornell/cornell.gltf");
    let quick = ["--preset", "preview", "--texels-per-meter", "4", "--gather", "1"];
    let bake =
        |words: &[&str]| run(home.path(), &[&["bake", input.to_str().unwrap(), "-o"], words, &quick[..]].concat());
    let (code, said) = bake(&["a.glb", "--light-groups", "--report", "a.lightmap-default0.exr"]);
    assert!(code == Some(3) && said.contains("two outputs have this name"), "{code:?} {said}");
    assert!(said.contains("atlas") && !said.contains("direct"), "{said}");
    assert!(files(home.path()).is_empty());

    // Links stay, and lead to what is new.
    fs::create_dir(home.path().join("far")).unwrap();
    std::os::unix::fs::symlink("far/b.glb", home.path().join("link.glb")).unwrap();
    for _ in 0..2 {
        let (code, said) = bake(&["link.glb"]);
        assert_eq!(code, Some(0), "{said}");
        assert!(home.path().join("link.glb").is_symlink() && home.path().join("far/b.glb").is_file());
    }
    assert_eq!(files(&home.path().join("far")).len(), 1);

    let page = home.path().join("link.lightmap0.exr");
    let before = fs::read(&page).unwrap();
    for words in
        [["render", "link.glb", "-o", "link.lightmap0.exr"], ["check", "link.glb", "--json", "link.lightmap0.exr"]]
    {
        let (code, said) = run(home.path(), &words);
        assert!(code == Some(3) && said.contains("would overwrite the input"), "{words:?}: {code:?} {said}");
        assert!(fs::read(&page).unwrap() == before);
    }
}

/// What a folder holds after a bake ended so, or what is wrong with it.
type Judge<'a> = &'a dyn Fn(&Path, ExitStatus) -> Result<&'static str, String>;

/// How much later to stop the next bake after one that had not ended, or earlier after one that had.
const STEP: f64 = 1.15;

/// Stops a bake at moments spread over its time, each time in a folder with the old files.
///
/// Half of them are near the end, where files are written. Where that is, the bakes before tell: one that was timed once may
/// have had the machine for itself, and then all that others are busy beside would be stopped too early.
fn stopped_at_moments(signal: &str, moments: u64, old: &Files, judge: Judge<'_>) {
    let folder = tempfile::tempdir().unwrap();
    let start = Instant::now();
    assert!(bake("", folder.path(), 2).status().unwrap().success());
    let mut whole = start.elapsed().as_secs_f64();
    let mut seen: BTreeMap<&str, u32> = BTreeMap::new();
    for moment in 0..moments {
        put_back(folder.path(), old);
        let child = bake("", folder.path(), 2).spawn().unwrap();
        let (part, near_end) = (Random::new(signal, 1, moment).below(1000) as f64 / 1000.0, moment % 2 == 1);
        let part = if near_end { 0.9 + 0.2 * part } else { part };
        std::thread::sleep(Duration::from_secs_f64(whole * part));
        let _ = Command::new("kill").args([signal, &child.id().to_string()]).stderr(Stdio::null()).status();
        let status = wait(child);
        let found =
            judge(folder.path(), status).unwrap_or_else(|e| panic!("{signal} at {part:.3} of {whole:.2} s: {e}"));
        if near_end {
            whole *= if found == "old" { STEP } else { STEP.recip() };
        }
        *seen.entry(found).or_default() += 1;
    }
    eprintln!("{signal}: {seen:?}");
    assert!(seen.len() > 1, "all moments were alike: {seen:?}");
}

#[test]
#[ignore = "slow: 50 bakes"]
fn a_kill_at_any_moment_leaves_whole_files() {
    let (_folder, old, new) = old_and_new();
    stopped_at_moments("-KILL", 50, &old, &|folder, _| {
        settle(folder)?;
        let after = files(folder);
        let found = if after == new {
            "new"
        } else if after == old {
            "old"
        } else {
            return Err(format!("a mixture, or files are missing: {:?}", after.keys()));
        };
        let again = bake("", folder, 2).status().map_err(|e| e.to_string())?;
        if !again.success() || files(folder) != new {
            return Err("the next bake does not give what a bake gives".to_owned());
        }
        Ok(found)
    });
}

/// Waits for a process that puts files in place to have ended its work after the bake that started it was killed.
fn settle(folder: &Path) -> Result<(), String> {
    let start = Instant::now();
    while fs::read_dir(folder).unwrap().any(|e| e.unwrap().file_name().to_string_lossy().starts_with(".texelwalk-")) {
        if start.elapsed() > PATIENCE {
            return Err("temporaries stay".to_owned());
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    Ok(())
}

#[test]
#[ignore = "slow: 20 bakes"]
fn an_interrupt_at_any_moment_leaves_all_old_or_all_new() {
    let (_folder, old, new) = old_and_new();
    stopped_at_moments("-INT", 20, &old, &|folder, status| {
        let after = files(folder);
        let found = match status.code() {
            Some(130) if after == old => "old",
            Some(0) if after == new => "new",
            // Before the program listens, the signal ends it as it ends any.
            None if after == old => "old",
            code => return Err(format!("exit code {code:?}, files {:?}", after.keys())),
        };
        Ok(found)
    });
}

fn put_back(folder: &Path, what: &Files) {
    fs::read_dir(folder).unwrap().for_each(|e| fs::remove_file(e.unwrap().path()).unwrap());
    what.iter().for_each(|(name, bytes)| fs::write(folder.join(name), bytes).unwrap());
}
