"""Time that the cockpit's page takes for a picture, in Chromium without a graphics card.

The script's share (scene, trail, marks, draw calls) is what an ordinary laptop has to do as well;
the rest is SwiftShader, which draws in software what a graphics card would.

    . tests/env.sh
    python tests/benchmarks/bench_page.py --out tests/benchmarks/results/page.json
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from chromium import chromium, inside, opened, until  # noqa: E402
from machine import machine  # noqa: E402
from served_page import served_page  # noqa: E402

PICTURE = """async () => {
    const { stage } = views;
    const gl = stage.renderer.getContext();
    const pixel = new Uint8Array(4);
    const told = { script: [], whole: [] };
    for (let n = 0; n < COUNT; n++) {
        player.seek(5 + 0.0167 * n);
        const begun = performance.now();
        frameOf();
        const asked = performance.now();
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel); // waits until it is drawn
        told.script.push(asked - begun);
        told.whole.push(performance.now() - begun);
        await new Promise((then) => setTimeout(then, 0));
    }
    return told;
}"""


def main() -> None:
    """Measure at both qualities and print, or write, the medians and the 95th percentiles."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    found: dict[str, Any] = {
        "machine": machine("playwright"),
        "pictures": given.count,
        "size": "858x590",
    }
    with tempfile.TemporaryDirectory() as folder:
        bag = ROOT / "tests" / "data" / "film-ride"
        with served_page([bag], Path(folder) / "web") as address, chromium(main="") as browser:
            for quality in ("high", "low"):
                with opened(browser, f"{address}?quality={quality}", "bag") as page:
                    until(page, "player.bag !== null && views.stage !== null")
                    until(page, "views.stage.bicycle !== null")
                    script = PICTURE.replace("COUNT", str(given.count))
                    script = script.replace("frameOf()", "drawOnce()")
                    frame_times = page.evaluate(
                        "async () => { const { views, player, drawOnce } = await import("
                        f"'/web/main.js'); return ({script})(); }}"
                    )
                    found[quality] = {name: _spread(times) for name, times in frame_times.items()}
                    found["renderer"] = inside(page, "views.stage.card")
    text = json.dumps(found, indent=2)
    if given.out:
        given.out.write_text(text + "\n")
    print(text)


def _spread(times: list[float]) -> dict[str, float]:
    ordered = sorted(times[len(times) // 5 :])  # without the first, which compile and upload
    return {
        "p50_ms": round(ordered[len(ordered) // 2], 2),
        "p95_ms": round(ordered[int(0.95 * len(ordered))], 2),
    }


if __name__ == "__main__":
    main()
