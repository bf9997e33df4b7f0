"""Khronos validator on baked files: no errors, and no warnings that the input did not have.

In: glTF or GLB files; `--input FILE` names what they were baked from. Out: a table on stdout; exit code 0, or 1 when a
file has an error, or a warning with a code that the input is free of. External buffers and images are read too. With
`--expect CODE,…` every file must have warnings with these codes as well, and no others.
"""

import argparse
import json
import sys

import environment

environment.enter()

import subprocess  # noqa: E402 (the environment comes first)
from pathlib import Path  # noqa: E402

SEVERITIES = ("error", "warning", "info", "hint")


def reports(files):
    """One validator report per file."""
    for file in files:
        if not Path(file).is_file():
            environment.fail(f"{file}: no such file")
    binary, _ = environment.node()
    script = Path(__file__).with_name("validate.cjs")
    done = subprocess.run([str(binary), str(script), str(environment.NODE / "node_modules"), *map(str, files)],
                          capture_output=True, text=True, check=False)
    if done.returncode != 0:
        environment.fail(f"the Khronos validator did not run: {done.stderr.strip()}")
    return json.loads(done.stdout)


def messages(report, severity):
    return [m for m in report["issues"]["messages"] if m["severity"] == severity]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="+")
    parser.add_argument("--input", help="what the files were baked from; its warning codes are allowed")
    parser.add_argument("--expect", default="", help="codes of warnings that every file must have")
    arguments = parser.parse_args()
    known, expected = set(), set(filter(None, arguments.expect.split(",")))
    if arguments.input:
        known = {m["code"] for m in messages(reports([arguments.input])[0], 1)}
    bad = 0
    print(f"{'errors':>7} {'warnings':>9} {'infos':>6}  file")
    for file, report in zip(arguments.files, reports(arguments.files)):
        issues = report["issues"]
        print(f"{issues['numErrors']:>7} {issues['numWarnings']:>9} {issues['numInfos']:>6}  {file}")
        missing = expected - {m["code"] for m in messages(report, 1)}
        for code in sorted(missing):
            print(f"    the expected warning {code} is missing")
        bad += len(missing)
        for message in issues["messages"]:
            new = message["severity"] == 1 and message["code"] not in known | expected
            fault = message["severity"] == 0 or new
            if message["severity"] < 2:
                note = "" if fault else " (expected, or in the input too)"
                kind = SEVERITIES[message["severity"]]
                print(f"    {kind} {message['code']} {message.get('pointer', '')}: {message['message']}{note}")
            bad += fault
    if bad:
        sys.stderr.write(f"error: {bad} fault(s) found by the Khronos validator\n")
        sys.exit(1)


if __name__ == "__main__":
    main()
