"""Time that the cockpit's page takes for a picture, in Chromium without a graphics card.

The script's share (scene, trail, marks, draw calls) is what an ordinary laptop has to do as well;
the rest is SwiftShader, which draws in software what a graphics card would:

- `flat`: the script for map, charts and words, at most 31 times a second;
- `stage`: the script for the bicycle in 3D, at each picture; `drawn`: until its pixels are there;
- `draw_calls` and `triangles` of a picture, its shadow included;
- `processor_ms` of a picture: `page`, the page's main thread (`flat`, `stage` and the wait for the
  pixels), `drawing`, all threads of SwiftShader's process. Other work on the machine does not
  lengthen these as it does the times.

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
from processor_times import processor_times  # noqa: E402
from served_page import served_page  # noqa: E402

PICTURE = """async (count) => {
    const { views, player, parts } = await import("/web/main.js");
    const gl = views.stage.renderer.getContext();
    const pixel = new Uint8Array(4);
    const told = { flat: [], stage: [], drawn: [], calls: 0, triangles: 0 };
    if (!window.counted) {
        window.counted = { calls: 0, triangles: 0 };
        const drawing = WebGL2RenderingContext.prototype;
        for (const [name, at] of [["drawArrays", 2], ["drawElements", 1]]) {
            const call = drawing[name];
            drawing[name] = function (...rest) {
                window.counted.calls += 1;
                window.counted.triangles += rest[0] === gl.TRIANGLES ? rest[at] / 3 : 0;
                return call.apply(this, rest);
            };
        }
    }
    const before = { ...window.counted };
    for (let n = 0; n < count; n++) {
        player.seek(5 + 0.0167 * n);
        let begun = performance.now();
        parts.flat();
        told.flat.push(performance.now() - begun);
        begun = performance.now();
        parts.stage();
        told.stage.push(performance.now() - begun);
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel); // waits until it is drawn
        told.drawn.push(performance.now() - begun);
    }
    told.calls = (window.counted.calls - before.calls) / count;
    told.triangles = (window.counted.triangles - before.triangles) / count;
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
                    page.evaluate(PICTURE, 10)  # compiles, uploads
                    before = processor_times()
                    pictures = page.evaluate(PICTURE, given.count)
                    after = processor_times()
                    found[quality] = {
                        **{part: _spread(pictures[part]) for part in ("flat", "stage", "drawn")},
                        "draw_calls": round(pictures["calls"]),
                        "triangles": round(pictures["triangles"]),
                        "processor_ms": {
                            name: round((after[name] - before[name]) / given.count, 2)
                            for name in after
                        },
                    }
                    found["renderer"] = inside(page, "views.stage.card")
    text = json.dumps(found, indent=2)
    if given.out:
        given.out.write_text(text + "\n")
    print(text)


def _spread(times: list[float]) -> dict[str, float]:
    ordered = sorted(times)
    return {
        "p50_ms": round(ordered[len(ordered) // 2], 2),
        "p95_ms": round(ordered[int(0.95 * len(ordered))], 2),
    }


if __name__ == "__main__":
    main()
