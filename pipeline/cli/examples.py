"""Examples of each command, shown at the end of its help."""

EXAMPLES = {
    "build": (
        "build mug.obj --material ceramic --length 0.16 -o mug.safetensors",
        "build vase.glb --material glass --wall 0.003 --keep truth -o vase.safetensors",
    ),
    "info": ("info mug.safetensors", "info mug.safetensors --json"),
    "sample": ("sample mug.safetensors --views 8 --contacts 8 --seed 0 -o queries",),
    "render": (
        "render mug.safetensors --turntable -o images",
        "render mug.safetensors --views queries/views.npy --resolution 512 -o images",
        "render mug.safetensors --views 4 --passes depth --passes mask -o images",
    ),
    "strike": (
        "strike mug.safetensors -o sounds",
        "strike mug.safetensors --points queries/points.npy --forces queries/forces.npy -o sounds",
        "strike mug.safetensors --striker steel 0.01 0.05 --listener 0.5 0 0.3 -o sounds",
    ),
    "press": (
        "press mug.safetensors --points queries/points.npy --depth 0.001 -o touches",
        "press mug.safetensors --points 4 --force 2 -o touches",
    ),
    "modes": ("modes mug.safetensors", "modes mug.obj --material ceramic --max-frequency 20000 --json"),
    "fit-sound": (
        "fit-sound strike_0.wav strike_1.wav bowl.obj --material ceramic -o bowl.csv",
        "fit-sound strike.wav mug.obj --material ceramic --mass 0.31 --hold-wall --json",
    ),
    "view": ("view mug.safetensors", "view data/object_files"),
    "add": ("add mug.obj --material ceramic --length 0.12 --licence CC0-1.0 --table data/my_objects.csv",),
    "check": ("check data/my_objects.csv --strict",),
    "fetch": ("fetch ycb:025_mug gso:ACE_Coffee_Mug_Kristen_16_oz_cup", "fetch --list ycb"),
    "calibrate": (
        "calibrate photographs --ball 4.70 -o sensor.yaml",
        "calibrate photographs --ball 4.70 --sensor gelsight --pixels-per-mm 19.58 -o sensor.yaml",
    ),
    "select": ("select --table data/my_objects.csv", "select --only mug,bell"),
    "partition": ("partition", "partition --objects 5000"),
    "plan": ("plan", "plan --count 1000 --workers 2 64"),
    "status": ("status --json",),
    "clean": ("clean", "clean --yes"),
    "starter": ("starter",),
    "code": ("code",),
    "inputs": ("inputs",),
    "record": ("record views",),
    "products": ("products --cluster slurm",),
    "stage": ("stage views",),
    "report": ("report", "report --summary"),
    "failures": ("failures",),
    "audit": ("audit v1 v2", "audit HEAD --max-loss vision.psnr_db=0.5 --html audit.html"),
    "verify": ("verify", "verify v1 --recompute 3"),
    "history": ("history mug",),
    "cards": ("cards",),
    "release": ("release v2 -o ../for-hugging-face",),
    "get": ("get https://example.org/objects.git@v1 mug -o objects", "get ../objects --list"),
    "export": (
        "export mug.safetensors --format gltf -o mug-gltf",
        "export mug --format nerf -o mug-nerf",
        "export mug bell --format mjcf -o assets",
    ),
    "export-samples": ("export-samples mug.safetensors --sense touch --queries 64 -o samples",),
    "gallery": ("gallery mug.safetensors bell.safetensors -o site", "gallery data/object_files -o site"),
    "scene": ("scene mug bell fork -o table/scene.xml",),
    "demo": ("demo",),
    "play": ("play table/scene.xml", "play table/scene.xml -o table/clip.mp4"),
}
# Of all commands, the first steps.
FIRST_STEPS = (
    "demo",
    "build",
    "info",
    "sample",
    "render",
    "strike",
    "press",
    "view",
    "fetch",
    "export",
    "plan",
)


def epilogue(*names: str) -> str:
    """Return the examples of a command, or the first of each of several, as the end of a help text."""
    lines = EXAMPLES[names[0]] if len(names) == 1 else tuple(EXAMPLES[name][0] for name in names)
    return "Examples:\n\n```\n" + "\n".join(f"objectfolder {line}" for line in lines) + "\n```\n"
