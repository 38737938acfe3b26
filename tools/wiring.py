"""Figure of the wiring of an emitter board on a breadboard: an emitter, a receiver and a motor."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle

from solen.report.canvas import INK, LEFT, RIGHT

Point = tuple[float, float]


def wire(axes: Axes, *points: Point) -> None:
    """Draw a line through some points."""
    axes.plot(*zip(*points, strict=True), color=INK, lw=1.4, solid_capstyle="round")


def resistor(axes: Axes, x: float, low: float, high: float, text: str, *, adjustable: bool = False) -> None:
    """Draw a vertical resistor between two heights, with wires to both ends."""
    middle = 0.5 * (low + high)
    wire(axes, (x, low), (x, middle - 0.5))
    wire(axes, (x, middle + 0.5), (x, high))
    axes.add_patch(Rectangle((x - 0.18, middle - 0.5), 0.36, 1.0, fill=False, ec=INK, lw=1.4))
    if adjustable:
        arrow = {"arrowstyle": "-|>", "color": INK, "lw": 1.2}
        axes.annotate("", (x + 0.45, middle + 0.45), (x - 0.45, middle - 0.45), arrowprops=arrow)
    axes.text(x + 0.55, middle, text, va="center", fontsize=8)


def ground(axes: Axes, x: float, y: float) -> None:
    """Draw a ground symbol below a point."""
    for index, half_width in enumerate((0.32, 0.2, 0.08)):
        wire(axes, (x - half_width, y - 0.12 * index), (x + half_width, y - 0.12 * index))


def supply(axes: Axes, x: float, y: float, text: str) -> None:
    """Draw a supply symbol above a point."""
    wire(axes, (x - 0.3, y), (x + 0.3, y))
    axes.text(x, y + 0.12, text, ha="center", va="bottom", fontsize=8)


def pin(axes: Axes, x: float, y: float, text: str, colour: str) -> None:
    """Draw a pin of the board, whose right end is at a point."""
    axes.add_patch(Rectangle((x - 2.1, y - 0.3), 2.1, 0.6, fc=colour, alpha=0.18, ec=colour))
    axes.text(x - 1.05, y, text, ha="center", va="center", fontsize=8)


def transistor(axes: Axes, x: float, y: float, text: str, *, lit: bool = False) -> None:
    """Draw an NPN transistor with its collector at (x, y + 0.8) and its emitter at (x, y - 0.8)."""
    axes.add_patch(Circle((x - 0.15, y), 0.55, fill=False, ec=INK, lw=1.2))
    wire(axes, (x - 0.35, y - 0.3), (x - 0.35, y + 0.3))
    wire(axes, (x - 0.35, y + 0.12), (x, y + 0.4), (x, y + 0.8))
    wire(axes, (x, y - 0.4), (x, y - 0.8))
    arrow = {"arrowstyle": "-|>", "color": INK, "lw": 1.2, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (x, y - 0.4), (x - 0.35, y - 0.12), arrowprops=arrow)
    if lit:
        rays(axes, x - 1.45, y + 0.25)
    axes.text(x + 0.55, y, text, va="center", fontsize=8)


def rays(axes: Axes, x: float, y: float) -> None:
    """Draw arrows of emitted or received light."""
    for offset in (0.0, 0.25):
        arrow = {"arrowstyle": "->", "color": RIGHT, "lw": 1.2}
        axes.annotate("", (x + 0.65, y + offset - 0.25), (x, y + offset), arrowprops=arrow)


def emitter(axes: Axes) -> None:
    """Draw the emitter circuit: 5 V, trimmer, resistor, LED, and transistor with its GPIO pin."""
    supply(axes, 4.0, 8.2, "5 V")
    resistor(axes, 4.0, 6.6, 8.2, "2 kΩ trimmer\n(power)", adjustable=True)
    resistor(axes, 4.0, 5.2, 6.6, "100 Ω")
    wire(axes, (4.0, 5.2), (4.0, 4.9))
    axes.add_patch(Polygon([(3.7, 4.9), (4.3, 4.9), (4.0, 4.4)], fill=False, ec=INK, lw=1.4))
    wire(axes, (3.7, 4.4), (4.3, 4.4))
    rays(axes, 4.35, 5.0)
    axes.text(5.15, 4.65, "VSMY1850", va="center", fontsize=8)
    wire(axes, (4.0, 4.4), (4.0, 3.3))
    transistor(axes, 4.0, 2.5, "NPN, 2N2222")
    wire(axes, (4.0, 1.7), (4.0, 1.2))
    ground(axes, 4.0, 1.2)
    wire(axes, (3.65, 2.5), (0.9, 2.5))
    axes.add_patch(Rectangle((1.0, 2.32), 1.0, 0.36, fc="white", ec=INK, lw=1.4, zorder=3))
    axes.text(1.5, 2.85, "1 kΩ", ha="center", fontsize=8)
    resistor(axes, 2.6, 1.2, 2.5, "")
    axes.text(2.3, 1.45, "10 kΩ", ha="right", fontsize=8)
    ground(axes, 2.6, 1.2)
    pin(axes, 0.9, 2.5, "emitter pin", RIGHT)
    axes.set_title("each emitter")


def receiver(axes: Axes) -> None:
    """Draw the receiver circuit: trimmer and resistor as load, phototransistor to ground, and the node at the ADC."""
    supply(axes, 3.0, 8.2, "3.3 V (Uno: 5 V)")
    resistor(axes, 3.0, 6.4, 8.2, "2 kΩ trimmer\n(sensitivity)", adjustable=True)
    resistor(axes, 3.0, 4.9, 6.4, "220 Ω")
    wire(axes, (3.0, 4.9), (3.0, 3.3))
    wire(axes, (3.0, 4.3), (0.9, 4.3))
    axes.plot(3.0, 4.3, "o", color=INK, ms=4)
    pin(axes, 0.9, 4.3, "input pin", LEFT)
    transistor(axes, 3.0, 2.5, "TEMT7100X01", lit=True)
    wire(axes, (3.0, 1.7), (3.0, 1.2))
    ground(axes, 3.0, 1.2)
    axes.set_title("each receiver")


def motor(axes: Axes) -> None:
    """Draw the motor circuit: step and direction lines to a driver with a separate supply."""
    axes.add_patch(Rectangle((2.2, 2.6), 2.6, 4.2, fill=False, ec=INK, lw=1.4))
    axes.text(3.5, 4.7, "stepper\ndriver\n(A4988)\nor servo", ha="center", va="center", fontsize=8)
    for height, text in ((6.1, "STEP pin"), (5.1, "DIR pin")):
        wire(axes, (0.9, height), (2.2, height))
        pin(axes, 0.9, height, text, INK)
    for height, text in ((6.1, "motor"), (5.1, "motor")):
        wire(axes, (4.8, height), (5.6, height))
        axes.text(5.7, height, text, va="center", fontsize=8)
    supply(axes, 3.5, 7.6, "separate supply")
    wire(axes, (3.5, 7.6), (3.5, 6.8))
    wire(axes, (3.5, 2.6), (3.5, 1.2))
    ground(axes, 3.5, 1.2)
    axes.text(3.9, 1.8, "common ground", fontsize=8)
    axes.set_title("motor (optional)")


def wiring() -> Figure:
    """Draw all three circuits side by side."""
    figure = Figure(figsize=(10.0, 3.8), layout="constrained")
    for axes, draw in zip(figure.subplots(1, 3), (emitter, receiver, motor), strict=True):
        draw(axes)
        axes.set(xlim=(-1.5, 7.2), ylim=(0.7, 9.0), aspect="equal")
        axes.axis("off")
    return figure
