//! The commands of the program, from typed options to exit code.

use crate::interrupt::Interrupt;
use crate::show;
#[cfg(unix)]
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
#[cfg(unix)]
use std::sync::Arc;
use texelwalk::atlas;
use texelwalk::bake::{self, Observer, Request};
use texelwalk::check::{self, Baked};
use texelwalk::cli;
use texelwalk::output::formats::Format;
use texelwalk::output::{File, atomic, exr, png, targets};
use texelwalk::render::{Lightmaps, View};
use texelwalk::scene;
use texelwalk::settings::{MOST_THREADS, Options, Preset, Settings, Target};
use texelwalk::{compare, html, inspect, output, render};

/// Exit codes; a contract with build systems.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Exit {
    /// All is well.
    Ok = 0,
    /// The bake failed.
    Failed = 1,
    /// The command line or a configuration file is wrong.
    Usage = 2,
    /// The input is invalid or needs something that is not supported.
    Input = 3,
    /// The file system said no.
    Io = 4,
    /// There were warnings under `--strict`.
    Strict = 5,
    /// `compare` found a difference, or `check` a fault.
    Differs = 7,
    /// Interrupted.
    Interrupted = 130,
}

type Outcome = Result<Exit, (Exit, String)>;

pub(crate) fn bake(typed: cli::Bake, interrupt: &Interrupt) -> Outcome {
    let (settings, threads) = layered(&typed.options, typed.config.as_deref(), typed.preset)?;
    if typed.usd.is_some() && settings.target == Target::Lightmap && !settings.format.contains(&Format::Exr) {
        return Err((Exit::Usage, "--usd refers to the lightmap as EXR; add exr to --format".to_owned()));
    }
    start_threads(threads)?;
    let observer: Box<dyn Observer> = show::observer(typed.quiet, typed.verbose);
    let request = Request {
        input: typed.input,
        output: typed.output,
        settings,
        preset: typed.preset,
        usd: typed.usd,
        report: typed.report,
        html: typed.html,
        depfile: typed.depfile,
        also_read: typed.config.into_iter().collect(),
        placer: placer(),
    };
    let outcome =
        bake::bake(&request, observer.as_ref(), interrupt.hold()).map_err(|e| (bake_exit(&e), e.to_string()))?;
    if !typed.quiet {
        show::outcome(&outcome, typed.verbose);
    }
    if typed.json {
        let bytes = outcome.report.to_json(Path::new("-")).map_err(|e| (Exit::Failed, e.to_string()))?;
        show::data(&bytes)?;
    }
    let strict = typed.strict && !outcome.report.warnings.is_empty();
    Ok(if strict { Exit::Strict } else { Exit::Ok })
}

/// Options over those of a configuration file over those of a preset: settings, and the number of threads. A fault that is
/// not there without the file is told with its name.
fn layered(
    typed: &Options,
    config: Option<&Path>,
    preset: Preset,
) -> Result<(Settings, Option<usize>), (Exit, String)> {
    let preset = Options::preset(preset).map_err(|e| (Exit::Usage, e.to_string()))?;
    let alone = typed.clone().over(preset.clone());
    let Some(path) = config else {
        let settings = alone.settings().map_err(|e| (Exit::Usage, e.to_string()))?;
        return Ok((settings, alone.threads));
    };
    let named = |why: &str| format!("{}: {why}", path.display());
    let text = std::fs::read_to_string(path).map_err(|e| (Exit::Io, named(&e.to_string())))?;
    let below = Options::from_toml(&text).map_err(|e| (Exit::Usage, named(&e.to_string())))?;
    let options = typed.clone().over(below).over(preset);
    let settings = options.settings().map_err(|e| {
        let (why, without) = (e.to_string(), alone.settings().err().map(|e| e.to_string()));
        (Exit::Usage, if without.as_ref() == Some(&why) { why } else { named(&why) })
    })?;
    Ok((settings, options.threads))
}

/// Starts the threads that work, of which this one is the first: hundreds of short loops are run from here, and each would
/// have to wake a thread and wait for it. Beside busy programs a bake on one thread took up to twice as long.
fn start_threads(threads: Option<usize>) -> Result<(), (Exit, String)> {
    if let Some(n) = threads.filter(|n| !(1..=MOST_THREADS).contains(n)) {
        return Err((Exit::Usage, format!("--threads {n} is out of range; it must lie between 1 and {MOST_THREADS}")));
    }
    // 0: as many as there are processors.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0)).use_current_thread().build_global();
    pool.map_err(|e| (Exit::Failed, format!("cannot start threads: {e}")))
}

fn bake_exit(error: &bake::Error) -> Exit {
    match error {
        bake::Error::Scene(e) => scene_exit(e),
        bake::Error::Atlas(atlas::Error::Setting(_)) => Exit::Usage,
        bake::Error::Atlas(_) | bake::Error::Memory(_) => Exit::Failed,
        bake::Error::Output(e) | bake::Error::Html(html::Error::Output(e)) => output_exit(e),
        bake::Error::Html(html::Error::Render(_)) => Exit::Failed,
        bake::Error::Interrupted => Exit::Interrupted,
    }
}

fn scene_exit(error: &scene::Error) -> Exit {
    match error.class() {
        scene::Class::Io => Exit::Io,
        scene::Class::Invalid | scene::Class::Unsupported => Exit::Input,
        scene::Class::Memory => Exit::Failed,
    }
}

fn output_exit(error: &output::Error) -> Exit {
    match error {
        output::Error::Io { .. } | output::Error::Target { .. } => Exit::Io,
        output::Error::Invalid { .. } => Exit::Input,
        output::Error::Interrupted => Exit::Interrupted,
        output::Error::Scene(e) => scene_exit(e),
    }
}

pub(crate) fn inspect(typed: &cli::Inspect) -> Outcome {
    let own = Options { texels_per_meter: typed.texels_per_meter, scene: typed.scene, ..Options::default() };
    let (settings, _) = layered(&own, typed.config.as_deref(), typed.preset)?;
    start_threads(None)?;
    let facts = inspect::inspect(&typed.input, &settings).map_err(|e| (bake_exit(&e), e.to_string()))?;
    let text = if typed.json { facts.to_json() } else { facts.to_text() };
    show::data(text.as_bytes())?;
    Ok(Exit::Ok)
}

pub(crate) fn compare(typed: &cli::Compare) -> Outcome {
    let read = |path: &Path| exr::read_rgba(path).map_err(|e| (output_exit(&e), e.to_string()));
    let (reference, test) = (read(&typed.reference)?, read(&typed.test)?);
    let mask = typed.mask.as_deref().map(read).transpose()?;
    let result = compare::compare(&reference, &test, mask.as_ref()).map_err(|e| (Exit::Input, e.to_string()))?;
    let text = if typed.json { result.to_json() } else { result.to_text() };
    show::data(text.as_bytes())?;
    let differs = typed.fail.is_some_and(|most| result.nrmse.is_nan() || result.nrmse > most);
    Ok(if differs { Exit::Differs } else { Exit::Ok })
}

pub(crate) fn render(typed: &cli::Render, interrupt: &Interrupt) -> Outcome {
    let output = [typed.output.as_path()];
    may_be_written(&output, core::slice::from_ref(&typed.input))?;
    start_threads(None)?;
    let how = scene::Settings { scene: typed.scene, ..scene::Settings::default() };
    let scene = scene::load(&typed.input, &how).map_err(|e| (scene_exit(&e), e.to_string()))?.output;
    let lightmaps = Lightmaps::load(&scene).map_err(|e| (output_exit(&e), e.to_string()))?;
    if lightmaps.is_empty() {
        let path = typed.input.display();
        return Err((Exit::Input, format!("{path}: has no lightmap; bake it first, and render what bake wrote")));
    }
    let inputs = [&scene.document.files_read[..], lightmaps.files_read()].concat();
    may_be_written(&output, &inputs)?;
    let settings = render::Settings {
        width: typed.width,
        height: typed.height,
        samples: typed.samples,
        exposure: typed.exposure,
        view: match (typed.auto, typed.camera) {
            (true, _) => View::Auto,
            (false, Some(n)) => View::Camera(n),
            (false, None) => View::Default,
        },
        overlay: typed.overlay,
        linear: is_exr(&typed.output),
    };
    let picture = render::render(&scene, &lightmaps, &settings).map_err(|e| (Exit::Usage, e.to_string()))?;
    let size = [picture.width, picture.height];
    let bytes = if settings.linear {
        exr::picture(&typed.output, size, &picture.pixels, &picture.coverage)
    } else {
        png::picture(&typed.output, size, &picture.pixels)
    };
    let bytes = bytes.map_err(|e| (output_exit(&e), e.to_string()))?;
    commit(&[(typed.output.clone(), bytes.into())], &inputs, interrupt)?;
    let scale = if settings.linear { "cd/m²".into() } else { format!("exposure {:+.2} stops", picture.exposure) };
    show::wrote(&format!("{} ({}, {scale})", typed.output.display(), picture.camera));
    Ok(Exit::Ok)
}

pub(crate) fn check(typed: &cli::Check, interrupt: &Interrupt) -> Outcome {
    let failed = |e: check::Error| match &e {
        check::Error::Scene(scene) => (scene_exit(scene), e.to_string()),
        check::Error::Lightmap(output) => (output_exit(output), e.to_string()),
    };
    let on_stdout = typed.json.as_deref() == Some(Path::new("-"));
    let json: Vec<&Path> = typed.json.as_deref().filter(|_| !on_stdout).into_iter().collect();
    may_be_written(&json, core::slice::from_ref(&typed.input))?;
    if let Some(folder) = &typed.pictures {
        targets::check_folder(folder).map_err(|e| (output_exit(&e), e.to_string()))?;
    }
    start_threads(typed.threads)?;
    let baked = Baked::load(&typed.input, typed.scene).map_err(failed)?;
    let inputs = [&baked.scene.document.files_read[..], baked.lightmaps.files_read()].concat();
    may_be_written(&json, &inputs)?;
    let settings = check::Settings { limits: typed.limits.iter().copied().collect(), padding: typed.padding };
    let report = check::check(&baked, &settings).map_err(failed)?;
    let mut files = vec![];
    if let Some(folder) = &typed.pictures {
        files = check::pictures::take(&baked, &report, folder).map_err(|e| (output_exit(&e), e.to_string()))?;
    }
    let report = report.in_document(baked.scene.offset);
    let text = if on_stdout { report.to_json() } else { report.to_text() };
    files.extend(json.into_iter().map(|path| (path.to_path_buf(), report.to_json().into_bytes().into())));
    commit(&files, &inputs, interrupt)?;
    show::data(text.as_bytes())?;
    for (path, _) in &files {
        show::wrote(&path.display().to_string());
    }
    let faulty = typed.fail && !report.faults.is_empty();
    Ok(if faulty { Exit::Differs } else { Exit::Ok })
}

fn is_exr(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"))
}

/// Refuses outputs that could not be put in place, before any work is done for them.
fn may_be_written(outputs: &[&Path], inputs: &[PathBuf]) -> Result<(), (Exit, String)> {
    let checked = targets::check(outputs, inputs).and_then(|()| targets::check_folders(outputs));
    checked.map_err(|e| (output_exit(&e), e.to_string()))
}

/// Puts the files of a command in place, unless somebody asks to stop before.
fn commit(files: &[File], inputs: &[PathBuf], interrupt: &Interrupt) -> Result<(), (Exit, String)> {
    let progress = interrupt.hold();
    let done = atomic::commit(files, inputs, placer().as_deref(), &|| progress.interrupted());
    done.map_err(|e| (output_exit(&e), e.to_string()))
}

/// This program, which can put files in place even where the process that wrote them is killed.
fn placer() -> Option<PathBuf> {
    // It leads to the running program even where its file was replaced or removed meanwhile, as by an update.
    let running = Path::new("/proc/self/exe");
    if cfg!(target_os = "linux") && running.exists() { Some(running.into()) } else { std::env::current_exe().ok() }
}

/// Serves another process of this program; see `output::placer`.
#[cfg(unix)]
pub(crate) fn place() -> Outcome {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
    let input = std::io::stdin();
    if input.is_terminal() {
        return Err((Exit::Usage, "texelwalk runs this by itself; there is nothing to type".to_owned()));
    }
    for signal in [SIGHUP, SIGINT, SIGQUIT, SIGTERM] {
        signal_hook::flag::register(signal, Arc::default()).map_err(|e| (Exit::Failed, e.to_string()))?;
    }
    output::placer::serve(input.lock(), std::io::stdout().lock()).map_err(|e| (Exit::Io, e.to_string()))?;
    Ok(Exit::Ok)
}
