// Which picture is the main one, the bicycle in 3D or the map, and which camera looks at it.


const STORED = "bicycle-cockpit-main";
const byId = (id) => document.getElementById(id);

/** What the address asks for: `quality=high|low`, `film=1`. */
export const asked = (name) => new URLSearchParams(location.search).get(name) ?? "";

function stored() {
  try {
    return localStorage.getItem(STORED);
  } catch {
    return null; // storage is forbidden
  }
}

export class Views {
  /**
   * @param {() => void} changed called when another picture or camera is chosen
   */
  constructor(changed) {
    this.changed = changed;
    this.stage = null;
    this.main = "map";
    this.section = byId("ride");
    this.refused = "";
    for (const button of document.querySelectorAll("[data-camera]")) {
      button.addEventListener("click", () => this.look(button.dataset.camera));
    }
  }

  /** Shows the picture of the last visit; 3D the first time. */
  start() {
    return this.choose(stored() ?? "3d", false);
  }

  swap() {
    return this.choose(this.main === "3d" ? "map" : "3d");
  }

  async choose(main, keep = true) {
    if (main === "3d" && !this.stage && !(await this.open())) main = "map";
    this.main = main;
    this.section.dataset.main = main;
    byId("swap").textContent = main === "3d" ? "Map" : "3D";
    byId("swap").title = main === "3d" ? "Show the map large (M)" : this.refused || "Show the bicycle in 3D (M)";
    byId("swap").disabled = Boolean(this.refused);
    try {
      if (keep) localStorage.setItem(STORED, main);
    } catch {
      // forbidden, see above
    }
    this.showCamera();
    this.changed();
  }

  /** Loads what draws in 3D; false where this browser cannot. */
  async open() {
    try {
      const { Stage } = await import("./scene/stage.js");
      this.stage = new Stage(byId("stage"), asked("film") ? "film" : asked("quality"));
      return true;
    } catch (error) {
      this.refused = "This browser has no WebGL 2: the bicycle is not drawn in 3D here";
      console.info(`${this.refused} (${error.message})`);
      return false;
    }
  }

  look(mode) {
    this.stage?.eye.choose(mode);
    this.showCamera();
    this.changed();
  }

  showCamera() {
    for (const button of document.querySelectorAll("[data-camera]")) {
      button.setAttribute("aria-pressed", String(button.dataset.camera === this.stage?.eye.mode));
    }
  }
}
