// The controls as the ride's status wants them, and the line that answers what was asked.

const byId = (id) => document.getElementById(id);

export function answer({ ok, message }) {
  byId("answer").textContent = message;
  byId("answer").dataset.ok = String(ok);
}

export function toggle(button) {
  button.setAttribute("aria-pressed", String(button.getAttribute("aria-pressed") !== "true"));
}

/** The controllers to choose from, in their groups. */
export function offer(controllers) {
  const groups = new Map();
  for (const one of controllers) groups.set(one.group, [...(groups.get(one.group) ?? []), one]);
  const unknown = Object.assign(new Option("–", ""), { hidden: true });
  byId("controller").replaceChildren(unknown, ...[...groups].map(([label, members]) => {
    const group = Object.assign(document.createElement("optgroup"), { label });
    group.append(...members.map(({ name, label }) => Object.assign(new Option(label ?? name, name), { title: name })));
    return group;
  }));
}

const RECORDING = { starting: "Recorder starts…", recording: "Stop recording", closing: "Closing the bag…" };

/**
 * @param status the cockpit's
 * @param {boolean} idle whether nothing can be asked for: a bag is shown, or there is no connection
 */
export function showControls(status, idle) {
  for (const control of document.querySelectorAll(".controls button, .controls select, .controls input")) control.disabled = idle;
  byId("pause").lastChild.textContent = status.paused ? "Go on" : "Pause";
  byId("pause").classList.toggle("on", status.paused);
  const { recording, who } = status;
  byId("record").lastChild.textContent = recording ? RECORDING[recording.phase] : "Record";
  byId("record").classList.toggle("on", recording?.phase === "recording");
  byId("record").disabled = idle || recording?.phase === "closing";
  const select = byId("controller");
  const names = [...select.options].map(({ value }) => value);
  if (select.options[0]) select.options[0].textContent = who.chosen.policy || "–";
  if (document.activeElement !== select) select.value = names.includes(who.chosen.name) ? who.chosen.name : "";
}
