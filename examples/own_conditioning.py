"""Own conditioning: the steps of Algorithm 1 by hand, with a flat support face cut at the end."""

import numpy as np

import lithoform

# The radius at each vertex of a sphere of 20,000 triangles (n = 50: 8 n^2).
ball = lithoform.sphere("octahedral", 50)
recipe = lithoform.Recipe(seed=3)
radius = lithoform.radii([recipe], ball.vertices)[0]
raw = ball.with_vertices(radius[:, None] * ball.vertices)
assert lithoform.check(raw).certificate == "star-shaped"  # as every radial graph is

# A twist keeps the distance of every vertex from the axis; here, the z axis.
twisted = lithoform.twist(raw, axis=(0, 0, 1), point=(0, 0, 0), rate=np.radians(30))
assert np.allclose(np.hypot(*twisted.vertices[:, :2].T), np.hypot(*raw.vertices[:, :2].T), atol=1e-12)

# Two steps of the Taubin pair take off the finest relief and hardly any volume.
smooth = lithoform.smooth(twisted, iterations=2, method="taubin")
assert abs(smooth.volume / twisted.volume - 1) < 0.01
assert smooth.mass_properties.area < twisted.mass_properties.area

# The axes of the solid instead of those of the vertices; metres from here on.
fitted = lithoform.fit_to_box(smooth, (0.040, 0.030, 0.020), weighting="solid")
assert np.allclose(np.ptp(fitted.vertices, axis=0), (0.040, 0.030, 0.020), rtol=1e-9)

# Cut 2 mm off the bottom; the cap is one plane that faces down.
flat = lithoform.flatten(fitted, depth=0.002)
bottom = flat.vertices[:, 2].min()
cap = (flat.vertices[flat.faces][:, :, 2] == bottom).all(axis=1)
assert np.isclose(bottom, fitted.vertices[:, 2].min() + 0.002)
assert (flat.area_vectors[cap] @ (0, 0, -1) > 0).all()
assert flat.volume < fitted.volume

report = lithoform.check(flat)
assert report.sound, report.problems()
print(f"{flat}: support face of {1e6 * np.linalg.norm(flat.area_vectors[cap].sum(axis=0)):.1f} mm2, sound")
