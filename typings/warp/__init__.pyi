# Warp compiles what its decorators mark, and its own hints do not describe that language: a vector times a
# number, a struct as a parameter. To the type checker everything of Warp is therefore Any.
from typing import Any

def __getattr__(name: str) -> Any: ...
