// The other bicycles of the domain: where they are, and which one is shown.

const byId = (id) => document.getElementById(id);

export class Fleet {
  /** @param {(name: string) => void} show asks the cockpit for another bicycle */
  constructor(show) {
    this.shown = "/";
    this.names = [];
    this.others = [];
    byId("bicycle").addEventListener("change", (event) => show(event.target.value));
  }

  /** Takes what the cockpit says; one bicycle alone needs no choice. */
  take({ shown, names, others }) {
    this.others = others;
    const known = names.join() === this.names.join();
    [this.shown, this.names] = [shown, names];
    const select = byId("bicycle");
    if (!known) select.replaceChildren(...names.map((name) => new Option(name, name)));
    if (!known || document.activeElement !== select) select.value = shown;
    byId("bicycle-label").hidden = names.length < 2;
  }
}
