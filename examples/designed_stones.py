"""A setting whose stones have four given descriptors on average, found in the library and made."""

import numpy as np

import lithoform
from lithoform.inverse.design import by_search
from lithoform.inverse.library import shipped_library
from lithoform.inverse.surrogate import Surrogate
from lithoform.inverse.targets import parse_target

library = shipped_library()
surrogate = Surrogate.fit(library)  # some seconds; any number of targets can share it

target = parse_target("roundness=0.33,boxiness=0.45,solidity=0.94,true_sphericity=0.80")
found = by_search(target, library, surrogate=surrogate, refine=False)  # at once; with refine the generator takes part
print("target  ", np.round(target.values, 3))
print("achieved", np.round(found.mean, 3), "by ten stones that scatter by", np.round(found.scatter, 3))
assert found.reached

stone = lithoform.generate(found.recipe.replace(seed=1))
assert stone.report.sound
