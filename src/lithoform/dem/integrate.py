"""One step of the blocks: sum of the forces, leapfrog, and the loop over steps on all threads of a processor.

Leapfrog with the angular momentum in the world's frame and the quaternion at the half step (Omelyan 1998, Comput. Phys.
12:97): the momentum of a closed system is kept to rounding.
"""

from __future__ import annotations

from lithoform.dem.arrays import CHUNK, ENDED, MOVES_TOO_FAR, NOT_FINITE, STALE, Scene
from lithoform.dem.boundary import move_walls, push_of_wall, sum_chunk
from lithoform.dem.narrowphase import evaluate_pair
from lithoform.warp_runtime import MODULE_OPTIONS, wp

__all__ = ["advance", "block_step", "pair_step", "wall_chunk_step", "wall_step"]

# The scene, kilobytes of pointers, is an argument of all functions: inlined they do not copy it for each pair.
wp.set_module_options(
    {**MODULE_OPTIONS, "cpu_compiler_flags": MODULE_OPTIONS["cpu_compiler_flags"].replace("9000", "90000")}
)

_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_HALF = wp.constant(wp.float64(0.5))
# A block may move by this share of its margin in a step; beyond it contacts would be missed.
_FARTHEST = wp.constant(wp.float64(0.5))


@wp.func
def _spin(momentum: wp.vec3d, orientation: wp.quatd, inertia: wp.vec3d) -> wp.vec3d:
    """Angular velocity [rad/s] in the world's frame."""
    return wp.quat_rotate(orientation, wp.cw_div(wp.quat_rotate_inv(orientation, momentum), inertia))


@wp.func
def _rotated(orientation: wp.quatd, spin: wp.vec3d, time: wp.float64) -> wp.quatd:
    half = _HALF * time
    return wp.normalize(wp.quatd(spin[0] * half, spin[1] * half, spin[2] * half, _ONE) * orientation)


@wp.func
def _against(force: wp.float64, velocity: wp.float64, damping: wp.float64) -> wp.float64:
    """Cundall's local damping of one component."""
    if velocity == _ZERO:
        return force
    return force - damping * wp.abs(force) * wp.sign(velocity)


@wp.func
def move_block(scene: Scene, i: wp.int32) -> wp.int32:
    """Sum the forces on a block and move it by one step; returns its faults, and STALE if it has moved far."""
    blocks = scene.blocks
    pairs = scene.pairs
    force = scene.gravity * blocks.mass[i]
    torque = wp.vec3d(_ZERO, _ZERO, _ZERO)
    for entry in range(blocks.entry_first[i], blocks.entry_first[i + 1]):
        p = blocks.entries[entry] / 2
        if pairs.radius[p] > _ZERO:
            if blocks.entries[entry] % 2 == 0:
                force += pairs.force[p]
                torque += pairs.torque_first[p]
            else:
                force -= pairs.force[p]
                torque += pairs.torque_second[p]
    flags = wp.int32(0)
    velocity = blocks.velocity[i]
    path = (wp.length(velocity) + wp.length(blocks.angular_velocity[i]) * blocks.bound[i]) * scene.dt
    for wall in range(scene.walls.count):
        push = push_of_wall(scene, i, wall, path)
        force += push.force
        torque += push.torque
        flags = flags | push.flags

    momentum = blocks.angular_momentum[i]
    if scene.damping > _ZERO:
        for k in range(3):
            force[k] = _against(force[k], velocity[k], scene.damping)
            torque[k] = _against(torque[k], momentum[k], scene.damping)
    orientation = blocks.orientation[i]
    inertia = blocks.inertia[i]
    velocity = velocity + force * (scene.kick / blocks.mass[i])
    momentum = momentum + torque * scene.kick
    half = _rotated(orientation, _spin(momentum, orientation, inertia), _HALF * scene.dt)
    spin = _spin(momentum, half, inertia)
    position = blocks.position[i] + velocity * scene.dt
    orientation = _rotated(orientation, spin, scene.dt)
    path = (wp.length(velocity) + wp.length(spin) * blocks.bound[i]) * scene.dt
    if not wp.isfinite(path):
        flags = flags | NOT_FINITE
    if path > _FARTHEST * blocks.margin[i]:
        flags = flags | MOVES_TOO_FAR
    if flags != 0:
        blocks.flags[i] = flags
        return flags
    blocks.force[i] = force
    blocks.torque[i] = torque
    blocks.velocity[i] = velocity
    blocks.angular_momentum[i] = momentum
    blocks.angular_velocity[i] = spin
    half_step = _HALF * scene.dt
    blocks.velocity_ahead[i] = velocity + force * (half_step / blocks.mass[i])
    blocks.spin_ahead[i] = _spin(momentum + torque * half_step, orientation, inertia)
    blocks.position[i] = position
    blocks.orientation[i] = orientation
    travel = blocks.travel[i] + path
    blocks.travel[i] = travel
    if travel <= scene.half_skin:
        return 0
    change = orientation * wp.quat_inverse(blocks.origin_orientation[i])
    turned = wp.sqrt(change[0] * change[0] + change[1] * change[1] + change[2] * change[2])
    moved = wp.length(position - blocks.origin[i]) + wp.float64(2.0) * turned * blocks.bound[i]
    if moved > scene.half_skin:
        return STALE
    return 0


# Functions take the scene by value, which is some kilobytes: a processor calls them once a chunk.
@wp.func
def _evaluate_pairs(scene: Scene, start: wp.int32, end: wp.int32) -> wp.int32:
    flags = wp.int32(0)
    for p in range(start, end):
        flags = flags | evaluate_pair(scene, p)
    return flags


@wp.func
def _move_blocks(scene: Scene, start: wp.int32, end: wp.int32) -> wp.int32:
    flags = wp.int32(0)
    for i in range(start, end):
        flags = flags | move_block(scene, i)
    return flags


@wp.func_native("""
#if !defined(__CUDACC__)
    wp::int32* all = epochs.data;
    __atomic_store_n(all + 16 * me, epoch, __ATOMIC_RELEASE);
    for (wp::int32 other = 0; other < count; ++other) {
        wp::int32 looks = 0;
        while (__atomic_load_n(all + 16 * other, __ATOMIC_ACQUIRE) < epoch) {
            ++looks;
            if (looks < 4000) {
#if defined(__x86_64__)
                __builtin_ia32_pause();
#endif
            } else if (pause) {
                typedef long (*pause_t)(unsigned);
                ((pause_t)pause)(looks < 4100 ? 0u : 20u);
            }
        }
    }
#endif
""")
def _wait_for_all(epochs: wp.array(dtype=wp.int32), me: wp.int32, count: wp.int32, epoch: wp.int32, pause: wp.uint64):
    """Wait until all threads have come here; `pause` is the address of usleep, for when a thread has no processor."""


@wp.func
def _any(flags: wp.array(dtype=wp.int32), count: wp.int32) -> wp.int32:
    together = wp.int32(0)
    for thread in range(count):
        together = together | flags[16 * thread]
    return together


@wp.kernel
def advance(
    scene: Scene,
    me: wp.int32,
    count: wp.int32,
    steps: wp.int32,
    epochs: wp.array(dtype=wp.int32),
    pair_flags: wp.array(dtype=wp.int32),
    block_flags: wp.array(dtype=wp.int32),
    done: wp.array(dtype=wp.int32),
    pause: wp.uint64,
) -> None:
    """Thread `me` of `count`: up to `steps` steps, until a block has a fault or the pairs are stale.

    Each thread takes chunks that follow each other, so that few lines of memory are shared, and waits for the others
    after the pairs and after the blocks.  What a pair or a block does depends on no other of the same phase: the result
    is the same whatever the number of threads.
    """
    block_count = scene.blocks.position.shape[0]
    pair_count = scene.pairs.first.shape[0]
    block_chunks = (block_count + CHUNK - 1) / CHUNK
    pair_chunks = (pair_count + CHUNK - 1) / CHUNK
    for step in range(steps):
        flags = wp.int32(0)
        for chunk in range(me * pair_chunks / count, (me + 1) * pair_chunks / count):
            flags = flags | _evaluate_pairs(scene, chunk * CHUNK, wp.min((chunk + 1) * CHUNK, pair_count))
        pair_flags[16 * me] = flags
        _wait_for_all(epochs, me, count, 3 * step + 1, pause)
        if _any(pair_flags, count) != 0:
            break
        for chunk in range(me * block_chunks / count, (me + 1) * block_chunks / count):
            flags = flags | _move_blocks(scene, chunk * CHUNK, wp.min((chunk + 1) * CHUNK, block_count))
            sum_chunk(scene, chunk)
        block_flags[16 * me] = flags
        _wait_for_all(epochs, me, count, 3 * step + 2, pause)
        flags = _any(block_flags, count)
        # A step with a fault is not made.
        if me == 0 and (flags & ~STALE) == 0:
            move_walls(scene, block_chunks)
            done[0] = step + 1
        if flags != 0:
            break


@wp.kernel
def pair_step(scene: Scene, control: wp.array(dtype=wp.int32)) -> None:
    """A pair on a GPU: nothing once a flag is up."""
    if control[0] == 0:
        flags = evaluate_pair(scene, wp.tid())
        if flags != 0:
            control[1] = flags


@wp.kernel
def block_step(scene: Scene, control: wp.array(dtype=wp.int32)) -> None:
    """A block on a GPU."""
    if control[0] == 0 and control[1] == 0:
        flags = move_block(scene, wp.tid())
        # Two words, so that a stale list does not overwrite a fault.
        if flags == STALE:
            control[2] = flags
        elif flags != 0:
            control[4] = flags


@wp.kernel
def wall_chunk_step(scene: Scene, control: wp.array(dtype=wp.int32)) -> None:
    """The walls' forces over a chunk of blocks on a GPU."""
    if control[0] == 0 and control[1] == 0:
        sum_chunk(scene, wp.tid())


@wp.kernel
def wall_step(scene: Scene, chunks: wp.int32, control: wp.array(dtype=wp.int32)) -> None:
    """The walls on a GPU, then the end of the step."""
    if control[0] == 0:
        if control[1] == 0 and control[4] == 0:
            move_walls(scene, chunks)
            control[3] = control[3] + 1
        if control[1] != 0 or control[2] != 0 or control[4] != 0:
            control[0] = ENDED
