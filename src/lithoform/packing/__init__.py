"""Stones poured into a container, settled under gravity and measured: `lithoform pack`.

    from lithoform.packing.request import Request
    from lithoform.packing.run import pack

    pack(Request(sources=(Path("stones"),), container="cylinder:150mm:200mm", count=300), Path("packing"))

Step by step: `request`, `container`, `stones` (what is packed), `placing`, `beforehand` (what is refused and told),
`settling`, `results`; `run` does it all, `folder` and `resuming` keep the files, `failing` tells of failures.
"""
