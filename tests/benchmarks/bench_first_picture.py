"""Time from the address to the cockpit's first pictures, in Chromium without a graphics card.

Each round opens the page of a live ride twice in a browser that has just started: with an empty
cache, and once more. The simulator, the controller, the cockpit and the browser share the
processor. Times are those of the page's own clock, which starts with the navigation:

- `html`, `modules`, `three`: the page, its last own module and three.js have arrived;
- `text`: Chromium's first contentful paint, head and controls;
- `map`: the 2D picture is drawn;
- `asked`: the script has made all calls of the first 3D picture (scene built, shaders compiled);
- `stage`: its pixels have been read back, so SwiftShader has drawn it;
- `processor_page`, `processor_drawing`: the processor time until then of the page's main thread
  and of all threads of SwiftShader's process, which other work on the machine does not lengthen.

    . tests/env.sh
    python tests/benchmarks/bench_first_picture.py --out FILE
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from statistics import median
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from chromium import BrowserPage, chromium, cockpit, opened  # noqa: E402
from machine import machine  # noqa: E402
from processor_times import processor_times  # noqa: E402
from waiting import until  # noqa: E402

PROBE = """(() => {
    const found = (window.firstPictures = {});
    let gl = null;
    let [map, stage] = [false, false];
    const get = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
        const context = get.call(this, kind, ...rest);
        if (this.id === "stage") gl = context;
        return context;
    };
    const { stroke } = CanvasRenderingContext2D.prototype;
    CanvasRenderingContext2D.prototype.stroke = function (...rest) {
        map ||= this.canvas.id === "map";
        return stroke.apply(this, rest);
    };
    const { drawElements } = WebGL2RenderingContext.prototype;
    WebGL2RenderingContext.prototype.drawElements = function (...rest) {
        stage ||= this === gl;
        return drawElements.apply(this, rest);
    };
    const ask = window.requestAnimationFrame.bind(window);
    window.requestAnimationFrame = (then) => ask((now) => {
        then(now);
        if (map) found.map ??= performance.now();
        if (!stage || found.stage) return;
        found.asked = performance.now();
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
        found.stage = performance.now();
    });
})();"""
TOLD = """() => {
    const parts = performance.getEntriesByType("resource");
    const [page] = performance.getEntriesByType("navigation");
    const [text] = performance.getEntriesByName("first-contentful-paint");
    const modules = parts.filter(({ name }) => name.endsWith(".js"));
    const last = (some) => Math.max(...some.map(({ responseEnd }) => responseEnd));
    const sent = parts.reduce((sum, { transferSize }) => sum + transferSize, page.transferSize);
    return {
        html: page.responseEnd,
        modules: last(modules.filter(({ name }) => !name.includes("/vendor/"))),
        three: last(modules.filter(({ name }) => name.includes("/vendor/"))),
        text: text?.startTime,
        ...window.firstPictures,
        files: 1 + parts.length,
        kilobytes: sent / 1000,
    };
}"""


def main() -> None:
    """Open the page again and again; print, or write, the median of each time."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    visits: dict[str, list[dict[str, float]]] = {"first visit": [], "second visit": []}
    found: dict[str, Any] = {"machine": machine("playwright"), "rounds": given.rounds}
    with cockpit("controller.policy:=fixed-speed") as (address, _, _):
        for _ in range(given.rounds):
            with chromium(main="") as browser:
                browser.add_init_script(PROBE)
                for times in visits.values():
                    before = processor_times()
                    with opened(browser, address) as page:
                        times.append(_first_pictures(page, before))
            print({name: times[-1] for name, times in visits.items()}, file=sys.stderr)
    for name, times in visits.items():
        middle = {key: median(one[key] for one in times) for key in times[0]}
        found[name] = {key: round(value, 1) for key, value in middle.items()}
        found[name]["slowest stage"] = round(max(one["stage"] for one in times), 1)
    text = json.dumps(found, indent=2)
    if given.out:
        given.out.write_text(text + "\n")
    print(text)


def _first_pictures(page: BrowserPage, before: dict[str, float]) -> dict[str, float]:
    """Return the times, ms, once the 3D picture is there."""
    until(lambda: page.evaluate("Boolean(firstPictures.stage && firstPictures.map)"))
    after = processor_times()
    found: dict[str, float] = page.evaluate(TOLD)
    spent = {f"processor_{name}": after[name] - before[name] for name in after}
    return {name: round(value, 1) for name, value in {**found, **spent}.items()}


if __name__ == "__main__":
    main()
