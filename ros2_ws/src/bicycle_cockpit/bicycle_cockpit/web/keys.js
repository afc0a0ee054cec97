// Shortcuts that work wherever the focus is, but where keys have a meaning of their own.

const KEYS = {
  ".": "step", r: "reset", R: "random", w: "waypoints", c: "clear", e: "record", a: "push-left", d: "push-right",
  f: "follow", "+": "zoom-in", "=": "zoom-in", "-": "zoom-out", l: "live", b: "bag", "?": "help",
};

/** @param actions by the id of their button @param space what the space bar does */
export function listenToKeys(actions, space) {
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.repeat) return;
    if (document.querySelector("dialog[open]")) return;
    const { tagName, type } = event.target;
    const typing = tagName === "SELECT" || tagName === "TEXTAREA" || (tagName === "INPUT" && type !== "range");
    if (typing) return;
    if (event.key === " ") {
      if (tagName === "BUTTON") return;
      event.preventDefault();
      space();
      return;
    }
    const action = KEYS[event.key];
    if (!action) return;
    event.preventDefault();
    actions[action]();
  });
}
