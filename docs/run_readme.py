"""Run the Python blocks of README.md, or of a guide, and compare what they print with what stands below them.

    python docs/run_readme.py                           # exits 1 and says where they differ
    python docs/run_readme.py --write                   # puts what was printed into README.md
    python docs/run_readme.py --write docs/cables.md    # into a guide
    python docs/run_readme.py --bench                   # measures, and puts the figures into the section "Speed"

A block "```python" may be followed by a block "```text": what it printed. Blocks share their names and run in a
temporary folder. Numbers, and what was worst when nothing was wrong, differ between machines: they do not count.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

README = Path(__file__).resolve().parents[1] / "README.md"
BLOCK = re.compile(r"```python\n(?P<code>.*?)```\n(?:\n```text\n(?P<output>.*?)```\n)?", re.S)
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
PLACE = re.compile(r"( at )[\d.]+ s.*")


def run_blocks(text: str) -> list[tuple[re.Match[str], str]]:
    """Run every block and give it with what it printed."""
    names: dict[str, object] = {"__name__": "readme"}
    results = []
    for match in BLOCK.finditer(text):
        line = text.count("\n", 0, match.start("code")) + 1
        code = compile("\n" * (line - 1) + match["code"], "README.md", "exec")  # errors tell the line of the README
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(code, names)
        results.append((match, printed.getvalue()))
    return results


def blur(output: str) -> list[str]:
    """Reduce an output to its words."""
    return [" ".join(NUMBER.sub("#", PLACE.sub(r"\1", line)).split()) for line in output.strip().splitlines()]


def differences(text: str) -> list[str]:
    """Say where the README tells something else than its blocks print."""
    found = []
    for match, printed in run_blocks(text):
        told, got = blur(match["output"] or ""), blur(printed)
        line = text.count("\n", 0, match.start()) + 1
        for i in range(max(len(told), len(got))):
            a, b = (lines[i] if i < len(lines) else "(nothing)" for lines in (told, got))
            if a != b:
                found.append(f"README.md, block of line {line}:\n  tells  {a}\n  prints {b}")
    return found


def refresh(text: str) -> str:
    """Put what the blocks print below them."""
    parts, end = [], 0
    for match, printed in run_blocks(text):
        parts += [text[end : match.start()], f"```python\n{match['code']}```\n"]
        parts += [f"\n```text\n{printed.rstrip()}\n```\n"] if printed.strip() else []
        end = match.end()
    return "".join([*parts, text[end:]])


def measure(text: str) -> str:
    """Run the benchmarks and put their tables between the marks."""
    sections = ("evaluations", "peers", "forward", "stages")
    command = [sys.executable, str(README.parent / "benchmarks" / "run.py")]
    command += [word for name in sections for word in ("--only", name)]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout.rstrip()
    return re.sub(r"(<!-- bench -->\n).*?(<!-- /bench -->)", rf"\1\n```text\n{printed}\n```\n\n\2", text, flags=re.S)


def main() -> None:
    """Compare, or write."""
    given = [word for word in sys.argv[1:] if not word.startswith("--")]
    page = Path(given[0]).resolve() if given else README
    text = page.read_text(encoding="utf-8")
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "tests").symlink_to(README.parent / "tests")  # for the data that a guide reads
        os.chdir(folder)
        try:
            if "--write" in sys.argv:
                page.write_text(refresh(text), encoding="utf-8")
            elif "--bench" in sys.argv:
                page.write_text(measure(text), encoding="utf-8")
            elif found := differences(text):
                sys.exit("\n".join(found).replace("README.md", page.name))
        finally:
            os.chdir(here)


if __name__ == "__main__":
    main()
