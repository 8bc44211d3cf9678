"""Draw the pictures of the documentation anew: docs/images/*.png and docs/images/parameters/*.png.

To be run when the noise, the conditioning, the measures or the drawing has changed.
"""

from pathlib import Path

import matplotlib.image as mpimg
import numpy as np

from lithoform import database_recipe, generate_many, particle_seed
from lithoform.figures.gallery import gallery, png_bytes
from lithoform.presets import SHAPE_CLASSES
from lithoform.reproduce.plates import parameter_plates
from lithoform.reproduce.shape import figure_3, figure_4

IMAGES = Path(__file__).resolve().parent.parent / "docs" / "images"


def main() -> None:
    # The stones of `make demo`.
    recipes = [database_recipe(SHAPE_CLASSES[n % 4], seed=particle_seed(1, n + 1)) for n in range(12)]
    captions = [
        f"{SHAPE_CLASSES[n % 4]}\n{' x '.join(f'{1e3 * d:.3g}' for d in r.size)} mm" for n, r in enumerate(recipes)
    ]
    target = IMAGES / "gallery.png"
    gallery([particle.mesh for particle in generate_many(recipes)], captions, target)
    _make_small(target, colours=128)
    parameter_plates(IMAGES / "parameters")
    for path in [*figure_3(IMAGES), *figure_4(IMAGES)]:
        if path.suffix == ".png":
            _make_small(path, colours=256)
        else:
            path.unlink()  # the table is written out on the page of validation


def _make_small(path: Path, *, colours: int) -> None:
    pixels = np.rint(255 * mpimg.imread(path)[..., :3]).astype(np.uint8)
    path.write_bytes(png_bytes(pixels, colours=colours))


if __name__ == "__main__":
    main()
