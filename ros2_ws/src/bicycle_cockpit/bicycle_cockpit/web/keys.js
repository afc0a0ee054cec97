// Shortcuts that work wherever the focus is, but where keys have a meaning of their own. Those of a single character
// can be switched off (WCAG 2.1.4): who speaks to the computer, or has a cat on the keyboard, sends none by accident.

const KEYS = {
  ".": "step", r: "reset", R: "random", w: "waypoints", c: "clear", e: "record", a: "push-left", d: "push-right",
  f: "follow", "+": "zoom-in", "=": "zoom-in", "-": "zoom-out", l: "live", b: "bag", "?": "help", s: "set-up", m: "swap", v: "camera",
};
const STORED = "bicycle-cockpit-letters";

/** @returns whether keys of a single character act; the browser remembers it */
function stored() {
  try {
    return localStorage.getItem(STORED) !== "off";
  } catch {
    return true; // storage is forbidden: the switch holds until the page is left
  }
}

/**
 * @param actions by the id of their button
 * @param space what the space bar does
 * @param {HTMLInputElement} letters the switch for keys of a single character
 */
export function listenToKeys(actions, space, letters) {
  letters.checked = stored();
  const show = () => document.documentElement.classList.toggle("no-letters", !letters.checked);
  show();
  letters.addEventListener("change", () => {
    show();
    try {
      localStorage.setItem(STORED, letters.checked ? "on" : "off");
    } catch {
      // forbidden, see above
    }
  });
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
    if (!action || !letters.checked) return;
    event.preventDefault();
    actions[action]();
  });
}
