"""The report on a network: powers for each emitter and receiver, rays, and the response over each motion."""

import numpy as np

from solen.fabricate import SolidFiles
from solen.report.design.html import NO_SOLID, page
from solen.sensor.network import NetworkResponse, NetworkStudy


def html(study: NetworkStudy, drawn: dict[str, str], solid: SolidFiles = NO_SOLID) -> str:
    """Return the HTML text of the report with the figures of `solen.report.design.network`, and links to the solid."""
    rest = study.at_rest
    heads = ("emitter", *rest.receivers)
    rows = zip(rest.emitters, rest.power[0].tolist(), strict=True)
    return page(
        "network.html",
        study,
        drawn,
        solid,
        lead=f"{study.check.kind}, {len(rest.emitters)} emitters in turn and {len(rest.receivers)} receivers",
        expected=expected(study),
        matrix=[heads, *((name, *powers) for name, powers in rows)],
        readings=list(zip(rest.readings, study.check.readings.values(), *_with_u(rest), strict=True)),
        u=f"{float(rest.u_power.max()):.1e}",
        parts=_parts(study),
    )


def expected(study: NetworkStudy) -> list[tuple[str, str]]:
    """Return headings and sentences: the received light, and the power that changes most over each motion."""
    rest = study.at_rest
    rows = []
    for number, name in enumerate(rest.emitters):
        brightest = int(np.argmax(rest.power[0, number]))
        power = f"{rest.power[0, number, brightest]:.4f} ± {rest.u_power[0, number, brightest]:.1g}"
        total = f"the receivers receive {float(rest.power[0, number].sum()):.3f} of its power"
        rows.append((f"{name} lit", f"{total}, {rest.receivers[brightest]} the most: {power}"))
    return [*rows, *((name, largest_change(response)) for name, response in study.sweeps.items())]


def _with_u(response: NetworkResponse) -> list[list[float | None]]:
    """Return the readings and uncertainties in a response's first state, with None for missing values."""
    columns = (response.reading[0], response.u_reading[0])
    return [[value if np.isfinite(value) else None for value in column.tolist()] for column in columns]


def largest_change(response: NetworkResponse) -> str:
    """Return a sentence on the power that changes most over a motion."""
    change = np.ptp(response.power, axis=0)
    emitter, receiver = map(int, np.unravel_index(int(np.argmax(change)), change.shape))
    power = response.power[:, emitter, receiver]
    low, high = float(power.min()), float(power.max())
    u = float(response.u_power[:, emitter, receiver].max())
    names = f"{response.receivers[receiver]} with {response.emitters[emitter]} lit"
    return f"changes {names} most, between {low:.4f} and {high:.4f} ± {u:.1g}"


def _parts(study: NetworkStudy) -> list[tuple[str, str, str]]:
    check, network = study.check, study.design.network
    rows = [(guide.name, "guide", f"from {guide.nodes[0]} to {guide.nodes[1]}") for guide in network.guides]
    for lens in check.lenses:
        sizes = f"half width {lens.half_width_mm:.4g} mm, {lens.depth_mm:.4g} mm deep"
        rows.append((lens.name, "lens", f"{lens.shape}, {sizes}"))
    for emitter in check.emitters:
        pose = f"x {emitter.x_mm:.4g}, z {emitter.z_mm:.4g} mm, towards {emitter.axis_deg:.4g}°"
        rows.append((emitter.name, "emitter", f"{pose}, {emitter.wavelength_nm:g} nm"))
    for receiver in network.receivers:
        position = f"end at {receiver.node}" if receiver.node else "drawn"
        if receiver.guide:
            position = f"{receiver.side} side of {receiver.guide}, {receiver.from_mm} to {receiver.to_mm} mm"
        rows.append((receiver.name, "receiver", position))
    for motion in network.motion:
        text = f"{motion.kind} of {motion.part}, {motion.from_deg:g}° to {motion.to_deg:g}°"
        rows.append((motion.name, "motion", text))
    return rows
