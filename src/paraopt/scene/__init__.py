"""Space: a robot among obstacles, the pairs that are checked, and clearance with its gradient.

What holds for every distance of this room, whatever measures it:

* **Distance.** Signed [m]: between separate bodies the smallest distance of their points; at contact 0; in penetration
  minus the smallest shift that parts them. Bodies are closed: touching is contact. It changes by at most the way of the
  bodies' points, through contact, too.
* **Normal and witness points.** The normal is a unit vector from the first body of the pair to the second, in
  penetration, too: moving the second body along it increases the distance. The witness points `p_1`, `p_2` lie on the
  surfaces and `p_2 - p_1 = distance * normal`. Swapping the bodies swaps the points and turns the normal.
* **Gradient.** `normal . (dp_2 - dp_1)` for the independent coordinates, each witness point moving as a part of its
  link. It is the derivative wherever there is one.
* **Kinks.** Where several pairs of points are as near (faces side by side, an edge taking over from a face, two bodies
  at the same distance), the distance is the smallest of several smooth functions. The gradient is then that of the
  witness points that are returned: along any motion the distance grows at that rate or slower. Where a penetration has
  several ways out that are as short, the gradient belongs to one of them: along any motion that keeps the witness
  points, the distance grows at that rate or faster.
* **Where there is no direction.** Cores that cross (the axes of two capsules, the centres of two balls): the distance
  is as everywhere, and the normal one of those along which they part by it.
* **Accuracy.** Separate bodies 1e-8 m; depths some 1e-6 m, where round solids are deep in each other up to 5e-4 m.
  Depths show the way out; only the sign certifies.
* **Meshes** are as near as the nearest of their convex parts; in penetration as deep as the deepest part, which is less
  than what parts the whole. **Half-spaces** have no distance to each other. **Cables** are measured without the lengths
  at their ends that are to be ignored; shorter ones shrink to a ball between the ends.
"""

from paraopt.scene.pairs import Body, Pair, SkippedPair
from paraopt.scene.rules import PairRule
from paraopt.scene.scene import Clearance, Distances, Scene
from paraopt.shapes import Cable

__all__ = ["Body", "Cable", "Clearance", "Distances", "Pair", "PairRule", "Scene", "SkippedPair"]
