"""What the kernels share: the blocks, the pairs, the walls and the scene as structs of arrays, and the fault flags."""

from __future__ import annotations

from lithoform.dem.contact import PairLaw
from lithoform.dem.gjk import Hulls, Simplex
from lithoform.warp_runtime import MODULE_OPTIONS, wp

__all__ = [
    "CANDIDATES", "CHUNK", "CORES_OVERLAP", "CYLINDER", "ENDED", "MOVES_TOO_FAR", "NOT_FINITE", "OUTSIDE", "PLANE",
    "STALE", "TOO_DEEP", "Blocks", "Pairs", "Scene", "Walls",
]  # fmt: skip

wp.set_module_options(MODULE_OPTIONS)

# Blocks (and pairs) that one thread takes at a time; sums over the blocks are sums of the sums of chunks.
CHUNK = wp.constant(16)
# Vertices that may take part in the contact with a wall, kept for each block near one.
CANDIDATES = wp.constant(32)

PLANE = wp.constant(0)
CYLINDER = wp.constant(1)

# Flags: STALE is no fault, the list of pairs must be made anew.
STALE = wp.constant(1)
CORES_OVERLAP = wp.constant(2)
OUTSIDE = wp.constant(4)
TOO_DEEP = wp.constant(8)
MOVES_TOO_FAR = wp.constant(16)
NOT_FINITE = wp.constant(32)
ENDED = wp.constant(64)


@wp.struct
class Blocks:
    """The blocks, n of them.

    position, velocity, angular_velocity, angular_momentum, force, torque : world's frame, SI units; velocities and
    momenta half a step behind the positions; velocity_ahead, spin_ahead : velocities at the time of the positions;
    orientation : from the frame of the shape to the world's; inertia : principal moments [kg m^2]; radius : of the
    sphere of equal volume; bound : of the sphere that holds the block; margin : of the rounding [m]; travel : bound of
    the path of any of its points since the list of pairs was made [m]; origin, origin_orientation : pose then;
    entry_first, entries : contacts of each block, 2 p + side; flags : faults.
    """

    shape: wp.array(dtype=wp.int32)
    material: wp.array(dtype=wp.int32)
    scale: wp.array(dtype=wp.float64)
    mass: wp.array(dtype=wp.float64)
    inertia: wp.array(dtype=wp.vec3d)
    radius: wp.array(dtype=wp.float64)
    bound: wp.array(dtype=wp.float64)
    margin: wp.array(dtype=wp.float64)
    position: wp.array(dtype=wp.vec3d)
    orientation: wp.array(dtype=wp.quatd)
    velocity: wp.array(dtype=wp.vec3d)
    angular_velocity: wp.array(dtype=wp.vec3d)
    velocity_ahead: wp.array(dtype=wp.vec3d)
    spin_ahead: wp.array(dtype=wp.vec3d)
    angular_momentum: wp.array(dtype=wp.vec3d)
    force: wp.array(dtype=wp.vec3d)
    torque: wp.array(dtype=wp.vec3d)
    travel: wp.array(dtype=wp.float64)
    origin: wp.array(dtype=wp.vec3d)
    origin_orientation: wp.array(dtype=wp.quatd)
    entry_first: wp.array(dtype=wp.int32)
    entries: wp.array(dtype=wp.int32)
    flags: wp.array(dtype=wp.int32)


@wp.struct
class Pairs:
    """Pairs of blocks that are in contact or may soon be, sorted by their numbers.

    limit : sum of both travels below which the pair cannot touch [m]; radius : of the contact disc [m], 0 without
    contact; spring [N], twist [N m]; normal : from the first to the second; force on the first [N]; torque_first,
    torque_second : on both about their centres [N m]; flags : faults.
    """

    first: wp.array(dtype=wp.int32)
    second: wp.array(dtype=wp.int32)
    simplex: wp.array(dtype=Simplex)
    limit: wp.array(dtype=wp.float64)
    radius: wp.array(dtype=wp.float64)
    spring: wp.array(dtype=wp.vec3d)
    twist: wp.array(dtype=wp.vec3d)
    normal: wp.array(dtype=wp.vec3d)
    force: wp.array(dtype=wp.vec3d)
    torque_first: wp.array(dtype=wp.vec3d)
    torque_second: wp.array(dtype=wp.vec3d)
    flags: wp.array(dtype=wp.int32)


@wp.struct
class Walls:
    """The walls, k of them, and the contact of each block with each wall at i k + w.

    direction : normal into the domain, or axis; pace, turning : magnitudes of the velocity and the angular velocity;
    speed : of a servo along its normal; turn : rotation of one step; servo : 1 where the wall is one; force : of the
    blocks on the wall; work : of the wall on the blocks [J], and present_power [W].
    Contacts: shared : by what the depths of vertices that share a contact differ [m]; candidates, candidate_count,
    budget : vertices that may take part, and the path for which that holds [m];
    radius, spring, twist as in Pairs; push : force on the block; power : of the wall on it [W].
    """

    count: wp.int32
    kind: wp.array(dtype=wp.int32)
    material: wp.array(dtype=wp.int32)
    cylinder_radius: wp.array(dtype=wp.float64)
    point: wp.array(dtype=wp.vec3d)
    direction: wp.array(dtype=wp.vec3d)
    velocity: wp.array(dtype=wp.vec3d)
    angular_velocity: wp.array(dtype=wp.vec3d)
    pivot: wp.array(dtype=wp.vec3d)
    pace: wp.array(dtype=wp.float64)
    turning: wp.array(dtype=wp.float64)
    nutates: wp.array(dtype=wp.int32)
    turn: wp.array(dtype=wp.mat33d)
    servo: wp.array(dtype=wp.int32)
    servo_force: wp.array(dtype=wp.float64)
    servo_mass: wp.array(dtype=wp.float64)
    servo_rate: wp.array(dtype=wp.float64)
    servo_speed: wp.array(dtype=wp.float64)
    speed: wp.array(dtype=wp.float64)
    force: wp.array(dtype=wp.vec3d)
    work: wp.array(dtype=wp.float64)
    present_power: wp.array(dtype=wp.float64)
    shared: wp.array(dtype=wp.float64)
    candidates: wp.array(dtype=wp.int32)
    candidate_count: wp.array(dtype=wp.int32)
    budget: wp.array(dtype=wp.float64)
    radius: wp.array(dtype=wp.float64)
    spring: wp.array(dtype=wp.vec3d)
    twist: wp.array(dtype=wp.vec3d)
    push: wp.array(dtype=wp.vec3d)
    power: wp.array(dtype=wp.float64)
    chunk_force: wp.array(dtype=wp.vec3d)
    chunk_power: wp.array(dtype=wp.float64)


@wp.struct
class Scene:
    """All that a step needs.

    dt : step [s]; kick : by what the velocities are advanced, dt but for the first step; gravity [m/s^2]; damping :
    Cundall's local damping; half_skin : displacement of a block at which the pairs are stale [m]; materials : their
    number; laws : of materials a and b at a materials + b.
    """

    dt: wp.float64
    kick: wp.float64
    gravity: wp.vec3d
    damping: wp.float64
    half_skin: wp.float64
    materials: wp.int32
    laws: wp.array(dtype=PairLaw)
    hulls: Hulls
    blocks: Blocks
    pairs: Pairs
    walls: Walls
