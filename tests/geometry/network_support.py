"""Networks for tests: the Y as a network, random trees of guides, and a network with two emitters."""

import random
from typing import Any

from solen.geometry import arm_angle_deg
from solen.spec import Design

Tables = dict[str, Any]


def y_network(design: Design, **network: Any) -> Design:
    """Return the Y of a design as a network: a flared stem, and two arms that are flush with its sides."""
    body, half_mm = design.body, design.lens.half_width_mm
    arms = [
        {
            "name": f"arm-{side}",
            "nodes": ("fork", f"tip-{side}"),
            "width_mm": body.arm_width_mm,
            "flush": side,
            "length_mm": body.arm_length_mm,
        }
        for side in ("right", "left")
    ]
    if body.arm_angle_deg is not None:
        for arm, sign in zip(arms, (-1.0, 1.0), strict=True):
            arm["direction_deg"] = sign * arm_angle_deg(design)
    stem = {
        "name": "stem",
        "nodes": ("base", "fork"),
        "width_mm": (2.0 * half_mm, 0.0, 2.0 * body.stem_curve_per_mm),
        "direction_deg": 0.0,
        "length_mm": body.stem_length_mm,
    }
    tables = {
        "nodes": [{"name": name} for name in ("base", "fork", "tip-right", "tip-left")],
        "guides": [stem, *arms],
        "lenses": [{"name": "main", "node": "base"}],
        "emitters": [{"name": "led", "lens": "main"}],
        "receivers": [{"name": side, "node": f"tip-{side}"} for side in ("right", "left")],
    }
    return Design(
        name=design.name,
        material=design.material,
        emitter=design.emitter,
        lens=design.lens,
        trace=design.trace,
        body={"kind": "network", "thickness_mm": body.thickness_mm},
        network=tables | network,
    )


def random_network(seed: int) -> Design:
    """Return a tree of guides with random widths, turns and fillets, a lens on the first end, receivers on others."""
    rng = random.Random(seed)  # noqa: S311  for shapes
    nodes: list[Tables] = [{"name": "n0"}]
    guides: list[Tables] = []

    def grow(node: str, heading_deg: float, depth: int) -> None:
        count = 1 if depth == 0 else rng.choice([0, 1, 2, 2, 3]) if depth < 3 else 0
        for i in range(count):
            spread = -60.0 + 120.0 * i / (count - 1) if count > 1 else 0.0
            direction = spread + rng.uniform(-8.0, 8.0)
            width, turn = rng.uniform(0.8, 2.5), rng.choice([0.0, 0.0, rng.uniform(-40.0, 40.0)])
            widths = [(width,), (width, rng.uniform(-0.02, 0.02)), (width, 0.0, rng.uniform(-0.002, 0.004))]
            nodes.append({"name": f"n{len(nodes)}", "fillet_mm": rng.choice([0.0, rng.uniform(0.05, 0.3)])})
            guides.append(
                {
                    "name": f"g{len(guides)}",
                    "nodes": (node, nodes[-1]["name"]),
                    "width_mm": rng.choice([*widths, (width, 0.01, 0.0, 1e-4)]),
                    "direction_deg": (heading_deg + direction + 180.0) % 360.0 - 180.0,
                    "length_mm": rng.uniform(9.0, 18.0) / (1.0 + 0.3 * depth),
                    "turn_deg": turn,
                }
            )
            grow(nodes[-1]["name"], heading_deg + direction + turn, depth + 1)

    grow("n0", 0.0, 0)
    guide_nodes = [node for guide in guides for node in guide["nodes"]]
    for node in nodes:
        node["fillet_mm"] = node.get("fillet_mm", 0.0) if guide_nodes.count(node["name"]) > 1 else 0.0
    ends = [node["name"] for node in nodes[1:] if guide_nodes.count(node["name"]) == 1]
    return Design(
        name=f"random {seed}",
        material={"index": 1.44},
        body={"kind": "network"},
        lens={"focus_mm": 12.0, "half_width_mm": 0.4},
        network={
            "nodes": nodes,
            "guides": guides,
            "lenses": [{"name": "lens", "node": "n0"}],
            "emitters": [{"name": "led", "lens": "lens"}],
            "receivers": [{"name": end, "node": end} for end in ends],
        },
    )


INDEX = 1.44


def three_guides(**network: Any) -> Design:
    """Return a trunk with a lens, a branch to a second lens on the right, and one to a receiver on the left."""
    guides = [
        {"name": "trunk", "nodes": ("base", "fork"), "width_mm": 3.0, "direction_deg": 0.0, "length_mm": 12.0},
        {"name": "branch", "nodes": ("fork", "tip"), "width_mm": 2.0, "direction_deg": -40.0, "length_mm": 10.0},
        {"name": "other", "nodes": ("fork", "end"), "width_mm": 2.0, "direction_deg": 40.0, "length_mm": 11.0},
    ]
    tables = {
        "nodes": [{"name": "base", "at_mm": (0.0, 0.0)}, *({"name": name} for name in ("fork", "tip", "end"))],
        "guides": guides,
        "lenses": [
            {"name": "main", "node": "base", "focus_mm": 15.0, "half_width_mm": 1.4},
            {"name": "second", "node": "tip", "focus_mm": 12.0},
        ],
        "emitters": [{"name": "a", "lens": "main"}, {"name": "b", "lens": "second", "distance_mm": 1.5}],
        "receivers": [
            {"name": "end", "node": "end"},
            {"name": "side", "guide": "trunk", "side": "left", "from_mm": 2.0, "to_mm": 5.0},
        ],
    }
    return Design(
        name="three",
        material={"index": INDEX, "absorption_per_mm": 0.01},
        emitter={"rays": 300},
        body={"kind": "network"},
        trace={"mode": "power"},
        network=tables | network,
    )


MOTIONS = [
    {"name": "lean", "kind": "bend", "part": "branch", "from_deg": -8.0, "to_deg": 8.0, "steps": 8},
    {"name": "swing", "kind": "rotation", "part": "other", "from_deg": -8.0, "to_deg": 8.0, "steps": 8},
]


READINGS = [
    {"name": "bend", "value": "(a.end - b.side) / (a.end + b.side)"},
    {"name": "most", "value": "max(abs(a.end - 2 * b.end), b.side ** 2) / 3 - -a.side"},
]
