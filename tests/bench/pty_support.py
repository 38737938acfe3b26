"""Boards on a pseudo-terminal, as at the end of a USB cable: the shipped firmware on simulated hardware.

`pico` runs main.py under CPython with a module ``machine`` that simulates pins, ADC and sensor; `uno` runs the image
compiled by gcc-avr under simavr. The steps that they make turn the sensor. POSIX only.
"""

import contextlib
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from solen.bench.board import CONFIGURATION
from solen.bench.clock import WallClock
from solen.bench.firmware.boards import sources_of
from solen.bench.firmware.solen_board import ALIVE, CONFIGURE, START
from solen.bench.frames import frame
from tests.bench.firmware_support import CORE, MODULE, micropython

STEPS_PER_DEG = 100.0
SLOW = 4
"""Factor by which boards run slower than real time, so that a busy computer can simulate them."""


class SlowClock(WallClock):
    """A clock of the host that runs slower by the same factor."""

    def __init__(self, at_s: float = 0.0) -> None:
        super().__init__(at_s, lambda: time.perf_counter() / SLOW)

    def sleep(self, duration_s: float) -> None:
        super().sleep(SLOW * duration_s)


MACHINE = """
import math
import os
import sys
import threading
import time

ON, STEPS, LOG = set(), [0], open(os.environ["BOARD_LOG"], "w")


class Pin:
    OUT = 1

    def __init__(self, number, mode=None, value=0):
        self.number, self.state = number, value

    def value(self, state):
        if self.number in (2, 3, 4, 5):
            (ON.add if state else ON.discard)(self.number)
            print(time.ticks_us(), self.number, int(state), file=LOG, flush=True)
        if self.number == 10 and state and not self.state:
            STEPS[0] += 1 if FORWARD.state else -1
        if self.number == 11:
            FORWARD.state = state
        self.state = state


FORWARD = Pin(-1)


class ADC:
    def __init__(self, pin):
        self.side = {26: 1.0, 27: -1.0}.get(pin.number, 0.0)

    def read_u16(self):
        if angle_file := os.environ.get("BOARD_ANGLE"):
            with open(angle_file) as file:
                angle = float(file.read())
        else:
            angle = STEPS[0] / STEPS_PER_DEG
        drop = 2.4 / (1.0 + math.exp(1.2 * self.side * angle)) if ON else 0.0
        return round(65535 * (3.2 - 0.05 - drop) / 3.3)


class PWM:
    def __init__(self, pin, freq):
        self.number = pin.number

    def duty_ns(self, pulse):
        print(time.ticks_us(), self.number, pulse, file=LOG, flush=True)


class Timer:
    PERIODIC = 1

    def __init__(self, period, mode, callback):
        def repeat():
            while True:
                time.sleep(SLOW * 1e-3 * period)
                callback(self)

        threading.Thread(target=repeat, daemon=True).start()
"""
RUN = """
import gc, os, select, sys, time, types
gc.mem_free = lambda: 1_000_000
time.ticks_us = lambda: int(1e6 * time.perf_counter() / SLOW)
time.ticks_diff = lambda a, b: a - b
sys.modules["micropython"] = types.SimpleNamespace(kbd_intr=lambda byte: None)
raw = types.SimpleNamespace(read=lambda size: os.read(0, size), write=lambda data: os.write(1, data), fileno=lambda: 0)
sys.stdin = sys.stdout = types.SimpleNamespace(buffer=raw, fileno=lambda: 0)


class Poll:
    def register(self, stream, mask):
        self.real = real_poll()
        self.real.register(0, mask)

    def poll(self, timeout):
        time.sleep(1e-4)
        return self.real.poll(0)


real_poll, select.poll = select.poll, Poll
import main
"""
SIMULATED_UNO = r"""
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <simavr/avr_adc.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>

static avr_t *avr;
static int on[4], forward, steps, accepts_input = 1;
static avr_irq_t *adc;
static FILE *report;

static double us(void) { return avr->cycle / 16.0; }

static void circuit(void) {
    int any = on[0] || on[1] || on[2] || on[3];
    for (int side = 0; side < 6; side++) {
        double angle = steps / STEPS_PER_DEG * (side % 2 ? -1 : 1);
        double drop = any ? 4000 / (1 + exp(1.2 * angle)) : 0;
        avr_raise_irq(adc + side, 4800 - 50 - drop);
    }
}

static void emitter(avr_irq_t *irq, uint32_t value, void *number) {
    (void)irq;
    on[(long)number] = value;
    fprintf(report, "%.0f %ld %d\n", us(), 2 + (long)number, (int)value);
    fflush(report);
    circuit();
}
static void direction(avr_irq_t *irq, uint32_t value, void *p) { (void)irq; (void)p; forward = value; }
static void step(avr_irq_t *irq, uint32_t value, void *p) {
    (void)irq; (void)p;
    if (value) steps += forward ? 1 : -1;
    circuit();
}
static void output(avr_irq_t *irq, uint32_t value, void *p) {
    (void)irq; (void)p;
    uint8_t byte = value;
    while (write(1, &byte, 1) < 0) continue;
}
static void flow(avr_irq_t *irq, uint32_t value, void *p) { (void)irq; (void)value; accepts_input = p != NULL; }

int main(int argc, char **argv) {
    (void)argc;
    elf_firmware_t image = {0};
    if (elf_read_firmware(argv[1], &image)) return 2;
    report = fopen(argv[2], "w");
    avr = avr_make_mcu_by_name("atmega328p");
    avr_init(avr);
    image.frequency = 16000000;
    avr_load_firmware(avr, &image);
    avr->vcc = avr->avcc = avr->aref = 5000;
    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    flags &= ~(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    avr_irq_t *uart = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), 0);
    avr_irq_register_notify(uart + UART_IRQ_OUTPUT, output, NULL);
    avr_irq_register_notify(uart + UART_IRQ_OUT_XON, flow, uart);
    avr_irq_register_notify(uart + UART_IRQ_OUT_XOFF, flow, NULL);
    adc = avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0);
    for (long pin = 0; pin < 4; pin++)
        avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('D'), 2 + pin), emitter, (void *)pin);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), 0), step, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), 1), direction, NULL);
    circuit();
    fcntl(0, F_SETFL, fcntl(0, F_GETFL) | O_NONBLOCK);
    struct timespec begin, now;
    clock_gettime(CLOCK_MONOTONIC, &begin);
    uint8_t input[64];
    int count = 0, next = 0;
    double polled_us = 0;
    for (;;) {
        int state = avr_run(avr);
        if (state == cpu_Done || state == cpu_Crashed) return 3;
        if (us() - polled_us < 30) continue; /* a byte takes 20 us */
        polled_us = us();
        if (next == count) {
            count = read(0, input, sizeof input);
            next = 0;
            if (count < 0) count = 0;
        }
        if (next < count && accepts_input) avr_raise_irq(uart + UART_IRQ_INPUT, input[next++]);
        clock_gettime(CLOCK_MONOTONIC, &now);
        double wall_us = (1e6 * (now.tv_sec - begin.tv_sec) + 1e-3 * (now.tv_nsec - begin.tv_nsec)) / SLOW;
        if (us() > wall_us + 500) usleep(SLOW * (us() - wall_us));
    }
}
"""


STREAM = """
import random, struct

random.seed(1)


class Line(Hardware):
    at, out, lost = 0, bytearray(), 0

    def now_us(self):
        return self.at

    def light(self, emitter):
        pass

    def sample(self, buffer, at, inputs):
        number = int.from_bytes(buffer[6:10], "little")
        first = (at - 18) // 2
        for index in (0, 1):
            value = number * (7, 11, 13, 17)[first + index] + first + index
            struct.pack_into("<H", buffer, at + 2 * index, value & 0xFFFF)

    def supports(self, half_us, emitters, inputs):
        return True

    def send(self, data):
        number, kind = int.from_bytes(data[6:10], "little"), data[3]
        fault = random.random() if kind == 1 and 0 < number < COUNT - 100 else 1.0
        data = bytearray(data)
        if fault < 0.005:
            self.lost += fault < 0.003
            at = random.randrange(2, len(data))
            if fault < 0.001:
                data[at] ^= 1 << random.randrange(8)
            elif fault < 0.002:
                data = data[:at] + data[at + 1 :]
            elif fault < 0.003:
                data = data[:at]
            elif fault < 0.004:
                data = data + data
            else:
                data += bytes([random.randrange(256) for _ in range(at)])
        self.out += data
        last = kind == 1 and number == COUNT - 1
        if last:
            report(self.lost)
        if len(self.out) > 4000 or last:
            put(self.out)
            self.out = bytearray()


line = Line()
board = Board(line, "stream")
for command in COMMANDS:
    board.receive(command)
line.out = bytearray()


def work(first, last):
    for number in range(first, last):
        line.at = board.next_us()
        if number % 200 == 0:
            board.receive(COMMANDS[-1])
        board.work()
"""
BY_PYTHON = """
import os, time
from solen_board import Board, Hardware


def put(data):
    while data:
        data = data[os.write(1, data) :]


def report(lost):
    open("lost", "w").write(str(lost))
"""
BY_MICROPYTHON = """
from binascii import hexlify
from wire import put_hex, report


def put(data):
    put_hex(hexlify(data).decode())
"""
NODE = f"""
import {{ loadMicroPython }} from "{MODULE}";
import {{ readFileSync, writeFileSync, writeSync }} from "fs";
const mp = await loadMicroPython({{ heapsize: 4 * 1024 * 1024 }});
function put_hex(text) {{
    for (let data = Buffer.from(text, "hex"); data.length; )
        try {{ data = data.subarray(writeSync(1, data)); }} catch (bad) {{ if (bad.code !== "EAGAIN") throw bad; }}
}}
mp.registerJsModule("wire", {{ put_hex, report: (lost) => writeFileSync("lost", String(lost)) }});
mp.runPython(readFileSync("stream.py", "utf-8"));
const last = 2 * Number(process.argv[2]);
for (let n = 0; n < last; n += 5000)  // garbage is collected between calls
    mp.runPython(`work(${{n}}, ${{Math.min(n + 5000, last)}})`);
setTimeout(() => 0, 60_000);
"""


def stream(folder: Path, count: int, *, by_micropython: bool = False) -> list[str] | str:
    """Return a command that sends frames of the core as fast as it can, some damaged, or why it is not available."""
    write_sources("pico", folder)
    (folder / "main.py").unlink()
    commands = [frame(CONFIGURE, 0, CONFIGURATION.pack(5000, 1, 2)), frame(START, 0, b""), frame(ALIVE, 0, b"")]
    text = f"COUNT, COMMANDS = {count}, {commands}\n{STREAM}"
    if by_micropython:
        node = micropython(folder)
        if isinstance(node, str):
            return node
        (folder / "stream.mjs").write_text(NODE, encoding="utf-8")
        text, line = CORE.read_text(encoding="utf-8") + BY_MICROPYTHON + text, [node[0], "stream.mjs", str(count)]
    else:
        text = f"{BY_PYTHON}\n{text}\nwork(0, {2 * count})\ntime.sleep(60)\n"
        line = [sys.executable, "stream.py"]
    (folder / "stream.py").write_text(text, encoding="utf-8")
    return line


@contextlib.contextmanager
def on_pty(line: list[str], folder: Path, log: Path, angle: Path | None = None) -> Iterator[str]:
    """Yield the port of a program that simulates a board; the file `angle`, if given, contains the sensor's angle."""
    import pty
    import tty

    board, host = pty.openpty()
    tty.setraw(host)
    environment = {**os.environ, "BOARD_LOG": str(log), "PYTHONDONTWRITEBYTECODE": "1"}
    environment |= {} if angle is None else {"BOARD_ANGLE": str(angle)}
    with subprocess.Popen(line, cwd=folder, stdin=board, stdout=board, env=environment) as child:
        try:
            yield os.ttyname(host)
        finally:
            child.kill()
            os.close(board)
            os.close(host)


def write_sources(kind: str, folder: Path) -> None:
    """Write the firmware of a kind of board into a folder."""
    for name, text in sources_of(kind).items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


def pico(folder: Path, *, servo: bool = False) -> list[str]:
    """Return the command of a simulated Pico, with a stepper or a servo."""
    write_sources("pico", folder)
    if servo:
        pins = (folder / "pins.py").read_text(encoding="utf-8")
        assert "SERVO = None" in pins
        (folder / "pins.py").write_text(pins.replace("SERVO = None", "SERVO = 12"), encoding="utf-8")
    (folder / "machine.py").write_text(f"STEPS_PER_DEG, SLOW = {STEPS_PER_DEG}, {SLOW}\n{MACHINE}", encoding="utf-8")
    (folder / "run.py").write_text(f"SLOW = {SLOW}\n{RUN}", encoding="utf-8")
    return [sys.executable, "run.py"]


def uno(folder: Path, log: Path) -> list[str] | str:
    """Return the command of a simulated Uno, or the reason why it is not available."""
    missing = [name for name in ("avr-gcc", "gcc", "simavr") if shutil.which(name) is None]
    if missing:
        return f"{', '.join(missing)} not installed (Debian: gcc-avr avr-libc simavr libsimavr-dev libelf-dev)"
    write_sources("uno", folder)
    sketch = folder / "solen_uno"
    avr = ["avr-gcc", "-mmcu=atmega328p", "-DF_CPU=16000000UL", "-Os", "-Wall", "-Wextra", "-Werror", "-std=gnu99"]
    files = [str(sketch / "uno.c"), str(sketch / "solen_board.c")]
    subprocess.run([*avr, *files, "-lm", "-o", str(folder / "uno.elf")], check=True)
    (folder / "uno_simulated.c").write_text(SIMULATED_UNO, encoding="utf-8")
    defines = [f"-DSTEPS_PER_DEG={STEPS_PER_DEG}", f"-DSLOW={SLOW}"]
    gcc = ["gcc", "-O2", *defines, str(folder / "uno_simulated.c"), "-lsimavr", "-lelf", "-lm"]
    subprocess.run([*gcc, "-o", str(folder / "uno_simulated")], check=True)
    return [str(folder / "uno_simulated"), str(folder / "uno.elf"), str(log)]


def switching(log: Path) -> list[tuple[int, int, int]]:
    """Return time in µs by the board clock, pin and level of each switch of an emitter."""
    entries = re.findall(r"(\d+) (\d+) ([01])\n", log.read_text(encoding="utf-8"))
    return [(int(time_us), int(pin), int(level)) for time_us, pin, level in entries]
