// The conditions of the ride: bicycle, scenario, speed, sensors, noise, pace; and the courses to ride along.

const byId = (id) => document.getElementById(id);
const WORDS = ["scenario", "plant", "bicycle", "sensors"];
/** Controllers that are proposed: for the paper's bicycle, for measured ones, and for estimates instead of the truth. */
const PAPER = "fixed-speed";
const ANY = "any-bicycle";
const CLASSICAL = "lqr";

/** Ids and descriptions are in the tooltips. */
const options = (items) => items.map(([name, label, about]) => Object.assign(new Option(label, name), { title: about ? `${name}: ${about}` : name }));

export class Setup {
  /**
   * @param {(type: string, fields: object) => Promise<void>} ask the cockpit
   * @param {() => string} chosen the name of the controller in charge
   */
  constructor(ask, chosen) {
    this.ask = ask;
    this.chosen = chosen;
    this.controllers = [];
    this.withBicycles = [];
    this.withNoise = [];
    this.values = null;
    byId("setup-form").addEventListener("submit", () => this.send());
    byId("setup-plant").addEventListener("change", () => this.suit());
    byId("setup-sensors").addEventListener("change", () => this.suit());
    byId("course").addEventListener("change", () => this.follow());
  }

  /** What can be chosen, as the cockpit's greeting says. */
  offer({ setups, setup, controllers }) {
    const { scenarios, plants, bicycles, sensors, courses, fastest, with_bicycles, with_noise } = setups;
    this.withBicycles = with_bicycles;
    this.withNoise = with_noise;
    byId("setup-scenario").replaceChildren(...options(scenarios));
    byId("setup-plant").replaceChildren(...options(plants));
    this.bicycles = bicycles;
    byId("setup-sensors").replaceChildren(...options([["", "None: it sees the truth"], ...sensors]));
    byId("setup-speed").max = String(fastest);
    byId("setup-note").hidden = setups.ours;
    byId("course").replaceChildren(new Option("–", ""), ...options(courses));
    this.groups = [...byId("controller").children].map((child) => child.cloneNode(true));
    this.controllers = controllers.map(({ name }) => name);
    this.values = setup;
  }

  open() {
    const { values } = this;
    if (!values) return;
    const own = values.own_bicycle ? [["", `Your own: ${values.own_bicycle.split("/").at(-1)}`, values.own_bicycle]] : [];
    byId("setup-bicycle").replaceChildren(...options([...own, ...this.bicycles]));
    for (const name of WORDS) byId(`setup-${name}`).value = values[name];
    if (!values.bicycle && !own.length) byId("setup-bicycle").value = "benchmark";
    byId("setup-speed").value = values.speed < 0 ? "" : String(values.speed);
    byId("setup-noise").value = String(Math.round(1e4 * values.noise) / 100);
    byId("setup-rate").value = String(values.rate);
    byId("setup-controller").replaceChildren(...this.groups.map((child) => child.cloneNode(true)));
    byId("setup-controller").value = this.controllers.includes(this.chosen()) ? this.chosen() : "";
    this.allow();
    byId("setup").showModal();
  }

  /** Only what the model has can be set. */
  allow() {
    const plant = byId("setup-plant").value;
    const noisy = this.withNoise.includes(plant);
    byId("setup-bicycle").disabled = !this.withBicycles.includes(plant);
    byId("setup-noise").disabled = !noisy;
    if (!noisy) byId("setup-noise").value = "0";
  }

  /** Proposes a controller that rides it; whoever rides can be chosen after that. */
  suit() {
    this.allow();
    const trained = this.withBicycles.includes(byId("setup-plant").value) ? ANY : PAPER;
    byId("setup-controller").value = byId("setup-sensors").value ? CLASSICAL : trained;
  }

  send() {
    const number = (id, otherwise) => (byId(id).value === "" ? otherwise : Number(byId(id).value));
    const fields = Object.fromEntries(WORDS.map((name) => [name, byId(`setup-${name}`).value]));
    const { bicycle, own_bicycle: own } = this.values;
    if (!this.withBicycles.includes(fields.plant) || (fields.bicycle === "benchmark" && !bicycle && !own)) fields.bicycle = "";
    this.ask("setup", { ...fields, speed: number("setup-speed", -1), noise: number("setup-noise", 0) / 100, rate: number("setup-rate", 1), controller: byId("setup-controller").value });
  }

  follow() {
    const name = byId("course").value;
    byId("course").value = "";
    if (name) this.ask("course", { name });
  }
}
