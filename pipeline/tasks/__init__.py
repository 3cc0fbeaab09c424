"""Task bodies, one module each, so that a change to one leaves the products of the others alone.

A body is a pure function ``body(request: Request) -> product`` (a tuple of products where
the stage makes several kinds): it sees the input files, parameters, record fields and seed that its
stage declares in `pipeline.dataset.stages`, imports only `objectfolder` and `pipeline.dataset.task`, and
returns `objectfolder.products.store.Product` for a ``.zarr.zip`` or
`objectfolder.products.tensor_file.TensorFile` for a ``.safetensors``. The framework adds
``fingerprint`` and ``provenance`` and writes the files.

``request.inputs`` has the paths under the kind's name (``request.inputs["views"]``),
``request.parameters`` the declared sections as dictionaries (``request.parameters["vision"]``).
The record of an object: ``name``, ``material`` (all values, a dictionary), ``appearance``
(``roughness``, ``metallic``), ``walls`` (``wall_m``, ``shell_m``), ``senses``, ``source``, ``licence``,
``attribution``.
"""
