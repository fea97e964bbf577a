"""Draws missions over the same field side by side, as an animation (APNG).

    pip install ./python pillow
    python python/examples/side_by_side.py scenarios/sparse.toml uts horizon --out sparse.png
    python python/examples/side_by_side.py scenarios/letter.toml tour --uavs 1 2 3 --side 1500 --out docs/src/fleets.png

A point is a sensor node, coloured by the fill level of its buffer, and red after it was full. The circles are the ranges of
the UAVs, the lines their last flights. With --uavs each strategy flies once with each number of UAVs, which
divide the field (`partition`).
"""

import argparse

import numpy as np
from PIL import Image, ImageDraw

import skysink

PIXELS = 300
"""Side of the drawn area."""
MARGIN, TITLE = 10, 44
"""Around it, and for the text above it."""
TRAIL = 25
"""Slots of the flight that are drawn."""
BACKGROUND, WRITING, FLIGHT, LOSS = (17, 19, 25), (220, 222, 228), (255, 255, 255), (255, 58, 48)
EMPTY, FULL = np.array([66, 108, 200]), np.array([255, 231, 76])


def places(table: skysink.Table, side_m: float) -> np.ndarray:
    """Pixel positions of the rows of a table with `x_m` and `y_m`, in an area of this side."""
    x_m, y_m = np.asarray(table["x_m"]), np.asarray(table["y_m"])
    return np.stack([MARGIN + x_m / side_m * PIXELS, TITLE + (1 - y_m / side_m) * PIXELS], axis=-1)


class Panel:
    """A mission, drawn slot by slot."""

    def __init__(self, run: skysink.Run) -> None:
        scenario, sensors = run.scenario, run.scenario.sensors()
        side_m = max(scenario["area.side_m"], 1.0)
        uavs = len(run.slots) // len(run)
        self.name = run.strategy if uavs == 1 else f"{run.strategy}, {uavs} UAVs"
        self.positions = places(sensors, side_m)
        self.flights = places(run.slots, side_m).reshape(len(run), uavs, 2).swapaxes(0, 1)
        self.radius = scenario["link.comm_radius_m"] / side_m * PIXELS
        self.fill = run.queues / scenario["sensors.capacity_bits"]
        self.lost_bits, self.sampled_bits = np.cumsum(run.slots["lost_bits"][::uavs]), run.summary["sampled_bits"] / len(run)
        self.is_full = np.logical_or.accumulate(self.fill >= 1.0, axis=0)

    def draw(self, slot: int) -> Image.Image:
        """The state after `slot`, from 1."""
        image = Image.new("RGB", (PIXELS + 2 * MARGIN, PIXELS + TITLE + MARGIN), BACKGROUND)
        pen = ImageDraw.Draw(image)
        loss_rate = self.lost_bits[slot - 1] / (self.sampled_bits * slot)
        pen.text((MARGIN, 8), self.name, fill=WRITING, font_size=16)
        pen.text((MARGIN, 26), f"slot {slot}: {100 * loss_rate:.1f} % of the data lost", fill=WRITING, font_size=12)
        pen.rectangle([MARGIN, TITLE, MARGIN + PIXELS, TITLE + PIXELS], outline=(60, 64, 76))
        for (x, y), fill, is_full in zip(self.positions, self.fill[slot], self.is_full[slot]):
            colour = LOSS if is_full else tuple(int(part) for part in EMPTY + min(fill, 1.0) * (FULL - EMPTY))
            pen.ellipse([x - 2.5, y - 2.5, x + 2.5, y + 2.5], fill=colour)
        for flight in self.flights:
            path = flight[max(0, slot - TRAIL) : slot]
            if len(path) > 1:
                pen.line([tuple(point) for point in path], fill=FLIGHT, width=2)
            x, y = path[-1]
            pen.ellipse(
                [x - self.radius, y - self.radius, x + self.radius, y + self.radius], outline=(90, 220, 240), width=2
            )
        return image


def missions(choice: argparse.Namespace) -> list[skysink.Run]:
    """The missions that are asked for."""
    scenario = skysink.Scenario.load(choice.scenario)
    if choice.side:
        scenario = scenario.replace({"area.side_m": choice.side})
    fleets = [scenario.replace({"uav.count": uavs, "uav.coordination": "partition"}) for uavs in choice.uavs]
    return [skysink.simulate(fleet, strategy) for strategy in choice.strategies for fleet in fleets or [scenario]]


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("scenario")
    arguments.add_argument("strategies", nargs="+")
    arguments.add_argument("--out", required=True, metavar="FILE")
    arguments.add_argument("--every", type=int, default=5, metavar="SLOTS", help="from one picture to the next [5]")
    arguments.add_argument("--uavs", type=int, nargs="+", default=[], metavar="U", help="numbers of UAVs [the scenario's]")
    arguments.add_argument("--side", type=float, metavar="METRES", help="side of the area [the scenario's]")
    choice = arguments.parse_args()
    panels = [Panel(run) for run in missions(choice)]
    frames = []
    for slot in range(1, min(panel.flights.shape[1] for panel in panels) + 1, choice.every):
        drawn = [panel.draw(slot) for panel in panels]
        frame = Image.new("RGB", (sum(image.width for image in drawn), drawn[0].height))
        left = 0
        for image in drawn:
            frame.paste(image, (left, 0))
            left += image.width
        frames.append(frame)
    palette = frames[len(frames) // 2].quantize(64)
    frames = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    frames[0].save(choice.out, save_all=True, append_images=frames[1:], duration=80, loop=0, optimize=True)
    print(f"{choice.out}: {len(frames)} pictures")


if __name__ == "__main__":
    main()
