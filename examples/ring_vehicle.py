"""A vehicle in Python in the place of flight-sim: it lags behind its waypoints, and drifts with the wind.

    skysink run scenarios/letter.toml --no-viewer --vehicle "python3 examples/ring_vehicle.py"

needs `pip install ./python`.
"""

import skysink.ring


class Slow(skysink.ring.Vehicle):
    def fly(self, order: skysink.ring.Order) -> skysink.ring.Flown:
        flown = 0.8 * (order.waypoint - order.position)
        drift = (0.3, -0.2, 0.0)
        return skysink.ring.Flown(order.position + flown + drift, velocity_mps=drift)


if __name__ == "__main__":
    skysink.ring.vehicle(Slow())
