"""The same bytes again: from a sidecar, in another order, in other batches, with another number of threads."""

import tempfile
from pathlib import Path

import lithoform

recipes = [lithoform.database_recipe("plate", seed=seed, triangles=5000) for seed in range(6)]
first = [stone.mesh.content_hash for stone in lithoform.generate_many(recipes, threads=1, batch_size=1)]
second = [stone.mesh.content_hash for stone in lithoform.generate_many(recipes[::-1], threads=4, batch_size=3)]
assert first == second[::-1]
assert len(set(first)) == len(first)  # neighbouring seeds are different stones

with tempfile.TemporaryDirectory() as folder:
    one, two = Path(folder) / "one.stl", Path(folder) / "two.stl"
    lithoform.generate(recipes[0]).save(one)
    # The sidecar holds the whole recipe.
    recipe = lithoform.read_recipe(one.with_suffix(".json"))
    assert recipe == recipes[0]
    lithoform.generate(recipe).save(two)
    assert one.read_bytes() == two.read_bytes()

    # So does a TOML file.
    toml = Path(folder) / "recipe.toml"
    toml.write_text(lithoform.to_toml(recipe), encoding="utf-8")
    assert lithoform.read_recipe(toml) == recipe

print("the same bytes:", first[0])
