"""An external planner in Python: flies to the fullest queue in reach, as gfs does.

    skysink run scenarios/letter.toml --planner "python3 examples/ring_planner.py"

needs `pip install ./python`. The same class works in `skysink.simulate(scenario, Greedy())`.
"""

import skysink
import skysink.ring


class Greedy(skysink.Strategy):
    def plan(self, view: skysink.View) -> skysink.Decision | None:
        reachable = view.field.within(view.uav, view.field.reach_m)
        if not len(reachable):
            return None  # transit rule: to the fullest queue of all
        fullest = reachable[view.queues_bits[reachable].argmax()]
        return skysink.Decision(view.field.positions_m[fullest])  # serves the fullest in range


if __name__ == "__main__":
    skysink.ring.planner(Greedy)
