"""Stones poured into a container, settled under gravity and measured: `lithoform pack`.

    from lithoform.packing.run import Request, pack

    pack(Request(sources=(Path("stones"),), container="cylinder:150mm:200mm", count=300), Path("packing"))

Step by step: `container`, `stones` (what is packed), `placing`, `settling`, `results`; `run` and `folder` put it in
files.
"""
