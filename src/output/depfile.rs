//! Make-style dependency rule: which files a bake wrote, and which it read.
//!
//! One rule with all outputs as targets, then an empty rule per input, so that make does not stop when an input was
//! deleted. Space and `#` are escaped with a backslash, backslashes before them are doubled, `$` becomes `$$`, as GNU
//! make and ninja read it. Known limit: neither has an escape for a line break; such a name is an error. On Windows
//! paths are written with forward slashes.

use super::Error;
use std::path::Path;
use std::path::PathBuf;

/// The text of a depfile.
///
/// # Errors
/// If a path is not UTF-8 or has a line break in it.
pub fn depfile(outputs: &[PathBuf], inputs: &[PathBuf]) -> Result<String, Error> {
    let targets: Vec<String> = outputs.iter().map(|p| escaped(p)).collect::<Result<_, _>>()?;
    let sources: Vec<String> = inputs.iter().map(|p| escaped(p)).collect::<Result<_, _>>()?;
    let mut text = format!("{}: {}\n", targets.join(" "), sources.join(" "));
    for (i, source) in sources.iter().enumerate() {
        if !sources[..i].contains(source) {
            text += &format!("{source}:\n");
        }
    }
    Ok(text)
}

fn escaped(path: &Path) -> Result<String, Error> {
    let name = path.to_str().ok_or_else(|| Error::invalid(path, "the path is not UTF-8; a depfile cannot name it"))?;
    let name = if cfg!(windows) { name.replace('\\', "/") } else { name.to_owned() };
    let mut out = String::new();
    let mut backslashes = 0;
    for c in name.chars() {
        match c {
            '\n' | '\r' => return Err(Error::invalid(path, "a depfile cannot name a path with a line break")),
            ' ' | '#' | '\t' => {
                out.extend(core::iter::repeat_n('\\', backslashes + 1));
                out.push(c);
            }
            '$' => out += "$$",
            _ => out.push(c),
        }
        backslashes = if c == '\\' { backslashes + 1 } else { 0 };
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escapes() {
        let paths = |names: &[&str]| names.iter().map(PathBuf::from).collect::<Vec<_>>();
        let text = depfile(&paths(&["o ut/a.glb", "o ut/a.exr"]), &paths(&["in/$x#1.gltf", "b.bin", "b.bin"])).unwrap();
        assert_eq!(text, "o\\ ut/a.glb o\\ ut/a.exr: in/$$x\\#1.gltf b.bin b.bin\nin/$$x\\#1.gltf:\nb.bin:\n");
        #[cfg(unix)]
        assert_eq!(escaped(Path::new("a\\ b\\c")).unwrap(), "a\\\\\\ b\\c");
        assert!(depfile(&paths(&["a\nb"]), &[]).is_err());
    }

    #[test]
    fn make_reads_the_names_back() {
        let folder = tempfile::tempdir().unwrap();
        let (input, output) = ("in $a #b c.gltf", "out put.glb");
        std::fs::write(folder.path().join(input), "x").unwrap();
        let rule = depfile(&[PathBuf::from(output)], &[PathBuf::from(input)]).unwrap();
        let first_rule = rule.lines().next().unwrap();
        std::fs::write(folder.path().join("Makefile"), format!("{first_rule}\n\t@printf '%s|%s' '$<' '$@'\n")).unwrap();
        let out = std::process::Command::new("make").current_dir(folder.path()).arg("-s").output();
        let out = out.expect("this test needs make (Debian: make)");
        assert_eq!(String::from_utf8_lossy(&out.stdout), format!("{input}|{output}"));
    }
}
