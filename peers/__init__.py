"""The same arms in other people's programs: `make peers` compares trajectories.

Exudyn (finite elements in absolute coordinates) and MuJoCo (rigid bodies in joint coordinates)
share neither equations nor code with flexarm, nor with each other: a mistake would have to be made
three times to stay hidden. Pinocchio and Drake move MuJoCo's rigid bars, PyElastica a Cosserat rod,
SoRoMoX segments of constant curvature; they are here to be timed by `make bench`. All install from
PyPI with the extra ``peers``.
"""
