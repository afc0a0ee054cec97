// The first minute: four things to try, ticked off as they are done. It is shown until it is done or closed.

const STORED = "bicycle-cockpit-guide";
const byId = (id) => document.getElementById(id);

export const STEPS = { goal: "Click on the ground to send the bicycle there", push: "Drag the rider to push it", switch: "Choose another controller", bag: "Record, then open the bag to watch it again" };

function stored() {
  try {
    return localStorage.getItem(STORED) !== "off";
  } catch {
    return false; // storage is forbidden: a guide that comes back at every visit would be in the way
  }
}

export class Guide {
  /** @param {boolean} wanted whether there is anything to try on this page */
  constructor(wanted) {
    this.box = byId("guide");
    this.items = new Map(Object.entries(STEPS).map(([name, text]) => [name, Object.assign(document.createElement("li"), { textContent: text })]));
    byId("guide-steps").replaceChildren(...this.items.values());
    byId("guide-close").addEventListener("click", () => this.end());
    this.box.hidden = !wanted || !stored();
  }

  /** Puts it aside while a bag is shown, in which nothing of it can be tried. */
  aside(away) {
    this.box.classList.toggle("away", away);
  }

  done(name) {
    const item = this.items.get(name);
    if (this.box.hidden || item.classList.contains("done")) return;
    item.classList.add("done");
    item.append(Object.assign(document.createElement("span"), { className: "visually-hidden", textContent: ", done" }));
    if ([...this.items.values()].every((one) => one.classList.contains("done"))) setTimeout(() => this.end(), 2500);
  }

  end() {
    this.box.hidden = true;
    try {
      localStorage.setItem(STORED, "off");
    } catch {
      // forbidden, see above
    }
  }
}
