"""A population: forty stones in the four Zingg classes, streamed, measured, none kept in memory."""

import numpy as np

import lithoform

CLASSES = ("cube", "plate", "column", "blade")
COUNT = 40

recipes = [
    lithoform.database_recipe(CLASSES[i % 4], seed=lithoform.particle_seed(2024, i + 1), triangles=5000)
    for i in range(COUNT)
]


def measure(index, stone):
    """How much of its box a stone fills; called in the worker threads."""
    length, width, height = stone.recipe.size
    return index, stone.report.sound, stone.mass_properties.volume / (length * width * height)


results = list(lithoform.generate_many(recipes, each=measure))

# Results come in the order of the recipes, however many threads there are.
assert [index for index, _, _ in results] == list(range(COUNT))
assert all(sound for _, sound, _ in results)

fill = np.array([share for _, _, share in results])
for k, name in enumerate(CLASSES):
    sizes = np.array([recipe.size for recipe in recipes[k::4]])
    elongation, flatness = sizes[:, 1] / sizes[:, 0], sizes[:, 2] / sizes[:, 1]
    assert ((elongation < 2 / 3) == (name in ("column", "blade"))).all()
    assert ((flatness < 2 / 3) == (name in ("plate", "blade"))).all()
    means = elongation.mean(), flatness.mean(), fill[k::4].mean()
    print("{:6s}  W/L {:.2f}  H/W {:.2f}  share of the box {:.2f}".format(name, *means))

# An ellipsoid fills pi/6 = 0.52 of its box, stones somewhat less.
assert 0.3 < fill.mean() < 0.52
