#!/usr/bin/env python3
"""Goal: src/ and tools/ are C, and not one compiler's: clang compiles every file without an error.
Method: the commands of the build, with clang in the compiler's place, and its assembly thrown away:
some errors come after the syntax only. Attributes that it ignores are errors: without its target a function is
another. Skipped where there is no clang, or the build is clang's.
test_clang.py BUILD ROOT"""
import concurrent.futures, json, os, shlex, shutil, subprocess, sys

build, root = sys.argv[1:]
clang = shutil.which("clang")
if clang is None:
    print("skipped: no clang")
    sys.exit(77)


def compiles(entry):
    words, given = [], iter(shlex.split(entry["command"]))
    for word in given:
        if word in ("-o", "-MQ", "-MF"):
            next(given)
        elif word != "-fdiagnostics-color=always" and word.startswith(("-I", "-D", "-std", "-f", "-isystem", "-pthread", "-m")):
            words.append(word)
    run = subprocess.run([clang, *words, "-Wno-everything", "-Werror=ignored-attributes", "-O0", "-S", "-o", os.devnull, entry["file"]],
                         cwd=entry["directory"], capture_output=True, text=True)
    if run.returncode != 0:
        print(f"FAILED: {entry['file']}: {run.stderr[:2000]}", flush=True)
    return run.returncode == 0


with open(os.path.join(build, "compile_commands.json"), encoding="utf-8") as file:
    entries = {path: entry for entry in json.load(file)
               for path in [os.path.relpath(os.path.join(build, entry["file"]), root)]
               if path.endswith(".c") and path.startswith(("src/", "tools/"))}
if len(entries) < 100:
    sys.exit(f"FAILED: {len(entries)} files only: is this the build's folder?")
with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
    good = list(pool.map(compiles, entries.values()))
print(f"{sum(good)} of {len(good)} files")
sys.exit(not all(good))
