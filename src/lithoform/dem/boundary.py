"""Force of a wall on a block, and the motion of the walls."""

from __future__ import annotations

from lithoform.dem.arrays import CANDIDATES, CHUNK, OUTSIDE, PLANE, TOO_DEEP, Scene
from lithoform.dem.contact import touch
from lithoform.warp_runtime import MODULE_OPTIONS, wp

__all__ = ["WallPush", "move_walls", "push_of_wall", "sum_chunk"]

wp.set_module_options(MODULE_OPTIONS)

_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_HALF = wp.constant(wp.float64(0.5))
# Path of a block for which the vertices that may come nearest to the wall are looked up, in bounding radii.
_BUDGET = wp.constant(wp.float64(0.004))
# Vertices do not share a contact where their depths differ by this many times the scale: exp(-20) is 2e-9.
_NONE = wp.constant(wp.float64(20.0))
# Depth in a wall that is a fault, in radii of the rounding.
_DEEPEST = wp.constant(wp.float64(3.0))


@wp.struct
class WallPush:
    """Force [N] and torque [N m] on a block, and its faults."""

    force: wp.vec3d
    torque: wp.vec3d
    flags: wp.int32


@wp.func
def _wall_rotation(scene: Scene, wall: wp.int32) -> wp.vec3d:
    """Angular velocity of the material of a wall [rad/s]."""
    rotation = scene.walls.angular_velocity[wall]
    if scene.walls.nutates[wall] == 1:
        axis = scene.walls.direction[wall]
        rotation = rotation - axis * wp.dot(rotation, axis)
    return rotation


@wp.func
def _off_axis(scene: Scene, wall: wp.int32, p: wp.vec3d) -> wp.vec3d:
    """Vector from the axis of a cylinder to a point [m]."""
    rel = p - scene.walls.point[wall]
    axis = scene.walls.direction[wall]
    return rel - axis * wp.dot(rel, axis)


@wp.func
def _clearance(scene: Scene, wall: wp.int32, p: wp.vec3d) -> wp.float64:
    """Distance of a point from a wall, positive inside the domain [m]."""
    if scene.walls.kind[wall] == PLANE:
        return wp.dot(scene.walls.direction[wall], p - scene.walls.point[wall])
    return scene.walls.cylinder_radius[wall] - wp.length(_off_axis(scene, wall, p))


@wp.func
def _look_up(scene: Scene, i: wp.int32, wall: wp.int32, h: wp.int32) -> wp.float64:
    """Note the vertices that may take part in the contact on the path to come; returns the path [m].

    While no point moves farther than b relative to the wall, they are among those that now are less than 2 b, and the
    depth that is shared, behind the foremost.  b is halved until they fit into the list; if that does not help, as with
    a disc on a plane, all vertices are looked at in each step of the whole path.
    """
    blocks = scene.blocks
    hulls = scene.hulls
    first = hulls.first[blocks.shape[i]]
    count = hulls.first[blocks.shape[i] + 1] - first
    turn = wp.quat_to_matrix(blocks.orientation[i])
    least = _clearance(scene, wall, blocks.position[i] + turn @ (hulls.vertices[first] * blocks.scale[i]))
    for k in range(1, count):
        clearance = _clearance(scene, wall, blocks.position[i] + turn @ (hulls.vertices[first + k] * blocks.scale[i]))
        least = wp.min(least, clearance)
    path = _BUDGET * blocks.bound[i]
    for _ in range(20):
        reach = least + wp.float64(2.0) * path + _NONE * scene.walls.shared[h]
        noted = wp.int32(0)
        for k in range(count):
            p = blocks.position[i] + turn @ (hulls.vertices[first + k] * blocks.scale[i])
            if _clearance(scene, wall, p) <= reach:
                if noted < CANDIDATES:
                    scene.walls.candidates[h * CANDIDATES + noted] = k
                noted += 1
        if noted <= CANDIDATES:
            scene.walls.candidate_count[h] = noted
            return path
        path = path * _HALF
    # All vertices are right on any path; a list is tried again after the longest.
    scene.walls.candidate_count[h] = 0
    return _BUDGET * blocks.bound[i]


@wp.func
def push_of_wall(scene: Scene, i: wp.int32, wall: wp.int32, path: wp.float64) -> WallPush:
    """Force of a wall on a block: one contact, whose depth and place are a smooth maximum over the vertices.

    With the depths d of the vertices and the scale s (`walls.shared`) the depth is s ln(sum exp(d / s)), and the force
    acts at the mean of the vertices with the weights exp(d / s): that of the deepest alone, unless others are as deep.
    A block so stands on a face as it should, and the force has a potential.  `path` bounds what any point of the block
    moves in a step [m].
    """
    blocks = scene.blocks
    walls = scene.walls
    result = WallPush()
    h = i * walls.count + wall
    x = blocks.position[i]
    bound = blocks.bound[i]
    # From the axis, or along the normal from the plane, to the centre.
    off = x - walls.point[wall]
    axis = walls.direction[wall]
    flat = walls.kind[wall] == PLANE
    clearance = wp.dot(axis, off)
    if not flat:
        off = off - axis * clearance
        clearance = walls.cylinder_radius[wall] - wp.length(off)
    if clearance < _ZERO:
        result.flags = OUTSIDE
        return result
    # The path of the block relative to the wall uses up what was looked up.
    wall_speed = walls.pace[wall] + wp.abs(walls.speed[wall])
    if walls.turning[wall] > _ZERO:
        wall_speed += walls.turning[wall] * (wp.length(x - walls.pivot[wall]) + bound)
    walls.budget[h] = walls.budget[h] - path - wall_speed * scene.dt
    former = walls.radius[h]
    if former == _ZERO and clearance >= bound:
        return result
    hulls = scene.hulls
    first = hulls.first[blocks.shape[i]]
    if walls.budget[h] <= _ZERO:
        walls.budget[h] = _look_up(scene, i, wall, h)
    count = walls.candidate_count[h]
    every = count == 0
    if every:
        count = hulls.first[blocks.shape[i] + 1] - first
    # In the frame of the block, where the vertices are.
    near_axis = wp.quat_rotate_inv(blocks.orientation[i], axis)
    near_off = wp.quat_rotate_inv(blocks.orientation[i], off)
    scale = walls.shared[h]
    least = _ZERO
    weights = _ZERO
    arm = wp.vec3d(_ZERO, _ZERO, _ZERO)
    for c in range(count):
        k = c
        if not every:
            k = walls.candidates[h * CANDIDATES + c]
        at = hulls.vertices[first + k] * blocks.scale[i]
        along = wp.dot(near_axis, at)
        here = clearance + along
        if not flat:
            here = walls.cylinder_radius[wall] - wp.length(near_off + at - near_axis * along)
        if c == 0 or here < least:
            # The sums so far are in units of the former foremost vertex.
            change = _ZERO
            if c > 0 and here > least - _NONE * scale:
                change = wp.exp((here - least) / scale)
            weights = weights * change + _ONE
            arm = arm * change + at
            least = here
        elif here < least + _NONE * scale:
            weight = wp.exp((least - here) / scale)
            weights += weight
            arm += weight * at
    arm = wp.quat_rotate(blocks.orientation[i], arm / weights)
    gap = least - blocks.margin[i]
    if weights > _ONE:
        gap -= scale * wp.log(weights)
    if former == _ZERO and gap >= _ZERO:
        return result
    # The distance from a wall is known at any depth, unlike that of two cores: a small block that carries the force of
    # a chain of large ones may be deeper in a wall than in another block.
    if gap < -_DEEPEST * blocks.margin[i]:
        result.flags = TOO_DEEP
        return result
    toward = -axis  # from the block to the wall
    if not flat:
        toward = wp.normalize(_off_axis(scene, wall, x + arm))
    arm = arm + toward * (blocks.margin[i] + _HALF * gap)
    rotation = _wall_rotation(scene, wall)
    # The wall's reference point is carried about the pivot; its material turns about that point.
    point = walls.point[wall]
    at_wall = walls.velocity[wall] + wp.cross(walls.angular_velocity[wall], point - walls.pivot[wall])
    at_wall += wp.cross(rotation, x + arm - point)
    if walls.servo[wall] == 1:
        at_wall = at_wall + walls.direction[wall] * walls.speed[wall]
    spin = blocks.angular_velocity[i]
    velocity = blocks.velocity[i] + wp.cross(spin, arm) - at_wall
    ahead = blocks.velocity_ahead[i] + wp.cross(blocks.spin_ahead[i], arm) - at_wall
    law = scene.laws[blocks.material[i] * scene.materials + walls.material[wall]]
    now = touch(law, -gap, blocks.radius[i], blocks.mass[i], toward, velocity, spin - rotation, ahead,
                blocks.spin_ahead[i] - rotation, _HALF * (spin + rotation), walls.spring[h], walls.twist[h], former,
                scene.dt)  # fmt: skip
    walls.radius[h] = now.radius
    walls.spring[h] = now.spring
    walls.twist[h] = now.twist
    walls.push[h] = now.force
    walls.power[h] = wp.dot(now.force, at_wall) + wp.dot(now.moment, rotation)
    result.force = now.force
    result.torque = wp.cross(arm, now.force) + now.moment
    return result


@wp.func
def sum_chunk(scene: Scene, chunk: wp.int32) -> None:
    """Forces and powers of the walls over the blocks of a chunk, in their order."""
    walls = scene.walls
    start = chunk * CHUNK
    end = wp.min(start + CHUNK, scene.blocks.position.shape[0])
    for wall in range(walls.count):
        force = wp.vec3d(_ZERO, _ZERO, _ZERO)
        power = wp.float64(0.0)
        for i in range(start, end):
            h = i * walls.count + wall
            if walls.radius[h] > _ZERO:
                force -= walls.push[h]
                power += walls.power[h]
        walls.chunk_force[chunk * walls.count + wall] = force
        walls.chunk_power[chunk * walls.count + wall] = power


@wp.func
def move_walls(scene: Scene, chunks: wp.int32) -> None:
    """Sum what the blocks do to each wall, then move it by one step."""
    walls = scene.walls
    for wall in range(walls.count):
        force = wp.vec3d(_ZERO, _ZERO, _ZERO)
        power = wp.float64(0.0)
        for chunk in range(chunks):
            force += walls.chunk_force[chunk * walls.count + wall]
            power += walls.chunk_power[chunk * walls.count + wall]
        walls.force[wall] = force
        step = walls.velocity[wall] * scene.dt
        pivot = walls.pivot[wall] + step
        walls.point[wall] = pivot + walls.turn[wall] @ (walls.point[wall] - walls.pivot[wall])
        walls.pivot[wall] = pivot
        walls.direction[wall] = wp.normalize(walls.turn[wall] @ walls.direction[wall])
        if walls.servo[wall] == 1:
            push = -wp.dot(force, walls.direction[wall])
            speed = walls.speed[wall] + scene.kick * (walls.servo_force[wall] - push) / walls.servo_mass[wall]
            # Damping implicitly, so that a short time does not make it unstable.
            speed = speed / (wp.float64(1.0) + scene.kick * walls.servo_rate[wall])
            speed = wp.clamp(speed, -walls.servo_speed[wall], walls.servo_speed[wall])
            # The blocks saw the speed of half a step before; the power is that of the mean of both.
            power += wp.dot(force, walls.direction[wall]) * _HALF * (walls.speed[wall] - speed)
            walls.speed[wall] = speed
            walls.point[wall] = walls.point[wall] + walls.direction[wall] * (speed * scene.dt)
        # Up to the time of these forces, at which the energy is told.
        walls.work[wall] = walls.work[wall] + _HALF * (walls.present_power[wall] + power) * scene.dt
        walls.present_power[wall] = power
