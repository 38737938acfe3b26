"""The core of the board in its three forms, run with the same script: under CPython, under MicroPython, and in C.

A line of a script contains a time in µs and the bytes from the host at that time, in hexadecimal. The counts of the
simulated hardware are a function of time, emitter and input.
"""

import contextlib
import io
import json
import shutil
import struct
import subprocess
from dataclasses import dataclass
from pathlib import Path

from solen.bench import firmware
from solen.bench.frames import frame

CORE = Path(firmware.__file__).parent / "solen_board.py"
SOURCES = CORE.parent / "sources"
REPLAY = """
class Replayed(Hardware):
    max_steps_per_s = 5000
    def __init__(self):
        self.at_us, self.lit = 0, -1
    def now_us(self):
        return self.at_us
    def light(self, emitter):
        self.lit = emitter
    def sample(self, buffer, at, inputs):
        for i in range(inputs):
            struct.pack_into("<H", buffer, at + 2 * i, (self.at_us // 7 + 1000 * (self.lit + 1) + 13 * i) & 0xFFFF)
    def send(self, data):
        print("".join("%02x" % byte for byte in data))
    def supports(self, half_us, emitters, inputs):
        return half_us >= 100 and emitters <= 4 and inputs <= 8
    def step(self, position, forward):
        pass

hardware = Replayed()
board = Board(hardware, "replayed")
for line in SCRIPT.split("\\n"):
    if not line:
        continue
    time_us, _, text = line.partition(" ")
    until = int(time_us)
    while text != "!":
        due = board.next_us()
        due = hardware.at_us + 100 if due is None else min(due, hardware.at_us + 100)
        if due > until:
            break
        hardware.at_us = max(due, hardware.at_us)
        board.work()
    hardware.at_us = until
    board.receive(b"" if text == "!" else bytes(int(text[i : i + 2], 16) for i in range(0, len(text), 2)))
"""
REPLAY_C = r"""
#include <stdio.h>
#include <stdlib.h>
#include "solen_board.h"
const char hw_name[] = "replayed";
const uint32_t hw_max_steps_per_s = 5000;
static uint64_t at_us;
static int lit = -1;
uint32_t hw_now_us(void) { return at_us; }
void hw_light(int8_t emitter) { lit = emitter; }
uint16_t hw_sample(uint8_t input) { return at_us / 7 + 1000 * (lit + 1) + 13 * input; }
void hw_send(const uint8_t *data, uint8_t size) { while (size--) printf("%02x", *data++); puts(""); }
bool hw_supports(uint32_t half_us, uint8_t emitters, uint8_t inputs) {
    return half_us >= 100 && emitters <= 4 && inputs <= 8;
}
void hw_step(int32_t position, bool forward) { (void)position; (void)forward; }
int main(void) {
    static char line[4096];
    while (fgets(line, sizeof line, stdin)) {
        char *text, pair[3] = "";
        uint64_t until = strtoull(line, &text, 10);
        while (text[1] != '!') {
            uint32_t next;
            uint64_t due = at_us + IDLE_US;
            if (board_next_us(&next) && at_us + (int32_t)(next - (uint32_t)at_us) < due)
                due = at_us + (int32_t)(next - (uint32_t)at_us);
            if (due > until) break;
            if (due > at_us) at_us = due;
            board_work();
        }
        at_us = until;
        for (text++; text[0] > '!'; text += 2) {
            pair[0] = text[0];
            pair[1] = text[1];
            board_receive(strtol(pair, NULL, 16));
        }
    }
}
"""
MODULE = "@micropython/micropython-webassembly-pyscript"
NODE = f"""
import {{ loadMicroPython }} from "{MODULE}";
import {{ readFileSync }} from "fs";
const print = (line) => console.log(line);
const mp = await loadMicroPython({{ heapsize: 4 * 1024 * 1024, stdout: print, linebuffer: true }});
mp.runPython(readFileSync(0, "utf-8"));
"""


@dataclass(frozen=True)
class Script:
    """Commands and their times in ms; None if the loop did not run since the previous one."""

    commands: tuple[tuple[float, bytes | None], ...]

    def __str__(self) -> str:
        return "".join(f"{round(1e3 * ms)} {'!' if data is None else data.hex()}\n" for ms, data in self.commands)


def frames_of(lines: str) -> list[bytes]:
    return [bytes.fromhex(line) for line in lines.split()]


def run_python(script: Script) -> list[bytes]:
    stdout = io.StringIO()
    with contextlib.redirect_stdout(stdout):
        exec(python_source(script), {"__name__": "replay"})  # noqa: S102  runs the firmware
    return frames_of(stdout.getvalue())


def python_source(script: Script) -> str:
    return f"{CORE.read_text(encoding='utf-8')}\nSCRIPT = {json.dumps(str(script))}\n{REPLAY}"


def run_c(script: Script, folder: Path, idle_us: int = 100) -> list[bytes] | None:
    """Return the frames if the loop runs at this interval while nothing is due; None without a compiler."""
    compiler = shutil.which("gcc") or shutil.which("cc") or shutil.which("clang")
    if compiler is None:
        return None
    program, source = folder / "replay", folder / "replay.c"
    source.write_text(REPLAY_C, encoding="utf-8")
    line = [compiler, "-std=c99", "-Wall", "-Wextra", "-Werror", f"-DIDLE_US={idle_us}", f"-I{SOURCES}", str(source)]
    subprocess.run([*line, str(SOURCES / "solen_board.c"), "-lm", "-o", str(program)], check=True)
    done = subprocess.run([str(program)], input=str(script), capture_output=True, text=True, check=True)
    return frames_of(done.stdout)


def micropython(folder: Path) -> list[str] | str:
    """Return a command that runs its standard input under MicroPython, or the reason why it is not available."""
    node, npm = shutil.which("node"), shutil.which("npm")
    if node is None or npm is None:
        return "node and npm are not installed"
    done = subprocess.run([npm, "install", "--silent", MODULE], cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        return f"MicroPython could not be installed: {done.stderr.strip()[:200]}"
    (folder / "run.mjs").write_text(NODE, encoding="utf-8")
    return [node, str(folder / "run.mjs")]


def run_micropython(command: list[str], source: str) -> list[bytes]:
    done = subprocess.run(command, input=source, capture_output=True, text=True, encoding="utf-8", check=True)
    return frames_of(done.stdout)


def command(kind: int, layout: str = "", *values: int) -> bytes:
    return frame(kind, 0, struct.pack(layout, *values))
