"""The contact of two bodies, or of a body and a wall: JKR, damping, friction and rolling friction (Table 8).

What goes beyond the letter of Table 8, and why:

- Damping (eq. 32, 34) carries the factor sqrt(5/6), with which a Hertzian impact restitutes what it is asked to
  (Antypov and Elliott 2011, EPL 94:50004).
- The tangential and the rolling spring are kept as force and moment.  When the contact grows they stay, when it shrinks
  they shrink with it: a spring whose stiffness follows the normal force would otherwise make energy (Thornton, Cummins
  and Cleary 2011, Powder Technol. 210:189).
- The tangential spring turns with the contact: onto the new tangent plane without loss, and with the bodies' mean spin
  about the normal.  The rolling spring turns with the bodies' mean spin.
- A block that spins on one point is braked by the friction of the contact disc, at most 3 pi / 16 mu_s a F (Johnson
  1985, Contact Mechanics, 7.4), of stiffness S_t a^2: rolling friction alone would let it spin for ever.
- What is damped is the velocity at the time of the force, forecast from the half step before: with that of half a step
  before, an impact at e = 0.2 restitutes 0.003 too little at the usual time step.
- The tangential force, damping included, is at most the limit of sliding.
- The rolling spring is damped like the tangential one, within its limit: without, a block on its flat side would rock
  for ever.
"""

from __future__ import annotations

import math

from lithoform.dem.jkr import contact_radius, normal_force
from lithoform.warp_runtime import MODULE_OPTIONS, wp

__all__ = ["PairLaw", "Touch", "touch"]

wp.set_module_options(MODULE_OPTIONS)

_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
# Of the friction on a disc that twists under the pressure of Hertz: 3 pi / 16 mu a F.
_TORSION = wp.constant(wp.float64(3.0 * math.pi / 16.0))
_SIX_PI = wp.constant(wp.float64(6.0 * math.pi))


@wp.struct
class PairLaw:
    """Constants of the contact of two materials.

    modulus : E* of eq. 36 [Pa]; shear : G* of eq. 41 [Pa]; energy : gamma [J/m^2]; sliding, rolling : coefficients of
    friction; damping : 2 sqrt(5/6) times the critical damping ratio of eq. 32.
    """

    modulus: wp.float64
    shear: wp.float64
    energy: wp.float64
    sliding: wp.float64
    rolling: wp.float64
    damping: wp.float64


@wp.struct
class Touch:
    """Force and moment on body A, and what the contact remembers.

    force [N] at the contact point; moment [N m] beyond that of the force; spring [N], twist [N m]: the tangential and
    rolling springs; radius : of the contact disc [m], 0 without contact; slides : 1 at the limit of friction.
    """

    force: wp.vec3d
    moment: wp.vec3d
    spring: wp.vec3d
    twist: wp.vec3d
    radius: wp.float64
    slides: wp.int32


@wp.func
def _turned(vector: wp.vec3d, normal: wp.vec3d, spin: wp.float64) -> wp.vec3d:
    """A vector of the former tangent plane in the present one, with its length, turned about the normal by `spin`."""
    flat = vector - normal * wp.dot(vector, normal)
    before = wp.dot(vector, vector)
    after = wp.dot(flat, flat)
    if after > _ZERO:
        flat = flat * wp.sqrt(before / after)
    return flat + spin * wp.cross(normal, flat)


@wp.func
def touch(
    law: PairLaw,
    overlap: wp.float64,
    radius: wp.float64,
    mass: wp.float64,
    normal: wp.vec3d,
    velocity: wp.vec3d,
    rotation: wp.vec3d,
    velocity_ahead: wp.vec3d,
    rotation_ahead: wp.vec3d,
    spin: wp.vec3d,
    spring: wp.vec3d,
    twist: wp.vec3d,
    former: wp.float64,
    dt: wp.float64,
) -> Touch:
    """Force and moment on body A.

    Parameters
    ----------
    overlap, radius, mass
        Overlap [m], effective radius [m] and mass [kg] of eq. 37 and 38.
    normal
        Unit vector from A to B.
    velocity, rotation
        Of A relative to B at the contact point [m/s], [rad/s], in the middle of the last step: what moves the springs.
    velocity_ahead, rotation_ahead
        The same now, by the last forces: what is damped.
    spin
        Mean angular velocity of both [rad/s].
    spring, twist, former
        What the contact remembers: tangential force [N], rolling moment [N m], contact radius [m].
    """
    result = Touch()
    a = contact_radius(overlap, law.modulus, radius, law.energy, former)
    if a == _ZERO:
        return result
    push = normal_force(a, law.modulus, radius, law.energy)
    limit = push + _SIX_PI * law.energy * radius
    stiffness = wp.float64(8.0) * law.shear * a
    shrinks = _ONE
    if former > a:
        shrinks = a / former
    approach = wp.dot(velocity_ahead, normal)
    damping = law.damping * wp.sqrt(wp.float64(2.0) * law.modulus * a * mass) * approach
    sliding = velocity_ahead - normal * approach

    slip = velocity - normal * wp.dot(velocity, normal)
    held = _turned(spring * shrinks, normal, wp.dot(spin, normal) * dt) - slip * (stiffness * dt)
    size = wp.length(held)
    most = law.sliding * limit
    if size > most:
        held = held * (most / size)
        result.slides = 1
    dragged = held - sliding * (law.damping * wp.sqrt(stiffness * mass))
    size = wp.length(dragged)
    if size > most:
        dragged = dragged * (most / size)

    # The moment turns with the bodies; its part about the normal has its own stiffness and limit.
    turned = twist + wp.cross(spin, twist) * dt
    # Its stiffness goes with the cube of the radius, and so it must shrink: else unloading would make energy.
    torsion = wp.dot(turned, normal)
    turned = (turned - normal * torsion) * shrinks
    torsion = torsion * shrinks * shrinks * shrinks
    twirl = wp.dot(rotation, normal)
    rolls = turned - (rotation - normal * twirl) * (stiffness * radius * radius * dt)
    size = wp.length(rolls)
    most = law.rolling * radius * limit
    if size > most:
        rolls = rolls * (most / size)
    drag = law.damping * wp.sqrt(stiffness * mass)
    twirl_ahead = wp.dot(rotation_ahead, normal)
    rolled = rolls - (rotation_ahead - normal * twirl_ahead) * (drag * radius * radius)
    size = wp.length(rolled)
    if size > most:
        rolled = rolled * (most / size)

    most = _TORSION * law.sliding * a * limit
    torsion = wp.clamp(torsion - twirl * stiffness * a * a * dt, -most, most)
    twisted = wp.clamp(torsion - twirl_ahead * drag * a * radius, -most, most)

    result.force = dragged - normal * (push + damping)
    result.moment = rolled + normal * twisted
    result.spring = held
    result.twist = rolls + normal * torsion
    result.radius = a
    return result
