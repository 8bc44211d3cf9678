"""Force of a pair of blocks: nearest points of the cores, overlap of the roundings, contact law."""

from __future__ import annotations

from lithoform.dem.arrays import CORES_OVERLAP, NOT_FINITE, Scene
from lithoform.dem.contact import touch
from lithoform.dem.gjk import gjk
from lithoform.warp_runtime import MODULE_OPTIONS, wp

__all__ = ["evaluate_pair", "pair_gap"]

wp.set_module_options(MODULE_OPTIONS)

_ZERO = wp.constant(wp.float64(0.0))
_HALF = wp.constant(wp.float64(0.5))
_HUGE = wp.constant(wp.float64(1e300))


@wp.func
def evaluate_pair(scene: Scene, p: wp.int32) -> wp.int32:
    """Forces of a pair; returns its faults."""
    blocks = scene.blocks
    pairs = scene.pairs
    i = pairs.first[p]
    j = pairs.second[p]
    former = pairs.radius[p]
    travel = blocks.travel[i] + blocks.travel[j]
    if former == _ZERO and travel < pairs.limit[p]:
        return 0
    margin = blocks.margin[i] + blocks.margin[j]
    far = margin
    if former > _ZERO:
        far = _HUGE
    inverse = wp.quat_inverse(blocks.orientation[i])
    apart = blocks.position[j] - blocks.position[i]
    found = gjk(scene.hulls, scene.hulls.first[blocks.shape[i]], scene.hulls.first[blocks.shape[j]],
                blocks.scale[i], blocks.scale[j], wp.quat_to_matrix(inverse * blocks.orientation[j]),
                wp.quat_rotate(inverse, apart), pairs.simplex[p], far)  # fmt: skip
    pairs.simplex[p] = found.simplex
    distance = wp.length(found.separation)
    if found.overlap == 1:
        pairs.flags[p] = CORES_OVERLAP
        return CORES_OVERLAP
    if not wp.isfinite(distance):
        pairs.flags[p] = NOT_FINITE
        return NOT_FINITE
    gap = found.lower - margin
    if found.complete == 1:
        gap = distance - margin
    if former == _ZERO and gap >= _ZERO:
        pairs.limit[p] = travel + gap
        return 0
    normal = wp.quat_rotate(blocks.orientation[i], found.separation * (-wp.float64(1.0) / distance))
    arm_i = wp.quat_rotate(blocks.orientation[i], found.point) + normal * (blocks.margin[i] + _HALF * gap)
    arm_j = arm_i - apart
    spin_i = blocks.angular_velocity[i]
    spin_j = blocks.angular_velocity[j]
    velocity = blocks.velocity[i] + wp.cross(spin_i, arm_i) - blocks.velocity[j] - wp.cross(spin_j, arm_j)
    ahead_i = blocks.spin_ahead[i]
    ahead_j = blocks.spin_ahead[j]
    ahead = blocks.velocity_ahead[i] + wp.cross(ahead_i, arm_i) - blocks.velocity_ahead[j] - wp.cross(ahead_j, arm_j)
    radius = blocks.radius[i] * blocks.radius[j] / (blocks.radius[i] + blocks.radius[j])
    mass = blocks.mass[i] * blocks.mass[j] / (blocks.mass[i] + blocks.mass[j])
    law = scene.laws[blocks.material[i] * scene.materials + blocks.material[j]]
    now = touch(law, -gap, radius, mass, normal, velocity, spin_i - spin_j, ahead, ahead_i - ahead_j,
                _HALF * (spin_i + spin_j), pairs.spring[p], pairs.twist[p], former, scene.dt)  # fmt: skip
    pairs.radius[p] = now.radius
    pairs.spring[p] = now.spring
    pairs.twist[p] = now.twist
    pairs.normal[p] = normal
    pairs.force[p] = now.force
    pairs.torque_first[p] = wp.cross(arm_i, now.force) + now.moment
    pairs.torque_second[p] = -wp.cross(arm_j, now.force) - now.moment
    if now.radius == _ZERO:
        pairs.limit[p] = travel + wp.max(gap, _ZERO)
    return 0


@wp.kernel
def pair_gap(scene: Scene, skin: wp.float64, start: wp.int32, gaps: wp.array(dtype=wp.float64)) -> None:
    """Gap of each pair [m], or a lower bound where it is beyond the skin; -1 where the cores overlap."""
    p = start + wp.tid()
    blocks = scene.blocks
    pairs = scene.pairs
    i = pairs.first[p]
    j = pairs.second[p]
    margin = blocks.margin[i] + blocks.margin[j]
    inverse = wp.quat_inverse(blocks.orientation[i])
    found = gjk(scene.hulls, scene.hulls.first[blocks.shape[i]], scene.hulls.first[blocks.shape[j]],
                blocks.scale[i], blocks.scale[j], wp.quat_to_matrix(inverse * blocks.orientation[j]),
                wp.quat_rotate(inverse, blocks.position[j] - blocks.position[i]), pairs.simplex[p],
                margin + skin)  # fmt: skip
    pairs.simplex[p] = found.simplex
    gap = found.lower - margin
    if found.complete == 1:
        gap = wp.length(found.separation) - margin
    if found.overlap == 1:
        gap = -margin
    gaps[p] = gap
    pairs.limit[p] = gap
