// The line below the head: who rides and why, or what keeps the bicycle from being ridden.

const byId = (id) => document.getElementById(id);
const seconds = (value) => `${value.toFixed(value < 10 ? 1 : 0)} s`;

/** What a person reads for a policy. */
export const labelOf = (rider) => rider?.label || rider?.name || "";

/** The same with what it is: "DDPG actor, a neural network,". */
const introduced = (rider) => (rider?.kind ? `${labelOf(rider)}, ${rider.kind},` : labelOf(rider));

/**
 * What is said of a live ride.
 *
 * @param {Live} live
 * @param {string} ended why the cockpit has ended, as far as it said
 * @returns {{level: string, text: string, alarm?: string, more?: string, rider?: object}} `alarm` is the trouble alone, without
 *   it the whole text; `more` changes all the time and is not read out
 */
export function tellLive(live, ended) {
  const { mode, status } = live;
  const { driver, chosen, why, since, stop } = status.who;
  const name = labelOf(chosen) || "no controller";
  if (mode === "lost") return { level: "bad", text: ended || "No connection to the cockpit. What is shown is old; the page tries again by itself." };
  if (mode === "loading") return { level: "info", text: "Loading the ride." };
  if (mode === "silent") return { level: "bad", text: sentence(status.trouble || "no simulator is heard") };
  if (mode === "fallen") {
    const more = `${status.paused ? " Time is paused as well: press Go on." : ""} ${sentence(status.trouble)}`;
    return { level: "bad", text: `The bicycle fell: press Reset to set it up again.${more}`.trim() };
  }
  if (status.trouble) return { level: "bad", text: sentence(status.trouble) };
  if (mode === "zero") return { level: "bad", text: "No command reaches the bicycle: it rides without input." };
  const alarm = status.misfit ? sentence(`${name} does not suit this ride: ${status.misfit}`) : "";
  const misfit = alarm && ` ${alarm}`;
  if (mode === "paused") return { level: "info", text: `Paused, ${name} in charge: Step makes one step, Go on lets it ride.${misfit}`, rider: chosen };
  if (mode === "held") return { level: misfit ? "warn" : "info", text: `${sentence(`${name} waits for a goal: click on the map`)}${misfit}`, alarm, rider: chosen };
  if (why) {
    const instead = driver.name === chosen.name ? `The safety layer's ${labelOf(driver)} rides` : `${labelOf(driver)} took over from ${name}`;
    const end = stop ? " It rides straight on and slows down: send a new goal to go on." : "";
    const more = Number.isFinite(since) ? ` ${seconds(Math.max(0, status.t - since))} ago.` : "";
    return { level: "warn", text: `${sentence(`${instead}: ${why}`)}${end}`, more, rider: driver };
  }
  const aim = status.goal ? "" : " straight on, without a goal: click on the map to send it somewhere";
  return { level: misfit ? "warn" : "info", text: `${sentence(`${introduced(driver) || name} rides${aim}`)}${misfit}`, alarm, rider: driver };
}

/** What is said of a bag at its cursor. */
export function tellBag(bag) {
  const rider = bag.rider;
  const last = bag.marks.findLast(({ kind }) => ["hand_over", "hand_back", "reset"].includes(kind));
  if (last?.kind === "hand_over" && rider && last.text.startsWith(`${labelOf(rider)} `)) {
    return { level: "warn", text: sentence(`${labelOf(rider)} took over: ${last.why}`), more: ` ${seconds(bag.time - last.t)} ago.`, rider };
  }
  return rider ? { level: "info", text: sentence(`${introduced(rider)} rode here`), rider } : { level: "info", text: "Nobody rides yet." };
}

/** What is warned of, if anything; figures in brackets stand in the line below the head only. */
export const alarmOf = ({ level, text, alarm = text }) => (["warn", "bad"].includes(level) ? alarm.replace(/ \([^)]*\)/, "") : "");

function sentence(text) {
  return /[.!?]$/.test(text) || !text ? text : `${text}.`;
}

/** Shows it; `colour` gives a rider's. */
export function showWho({ level, text, more = "", rider }, colour) {
  const box = byId("who");
  box.dataset.level = level;
  if (byId("who-text").textContent !== text) byId("who-text").textContent = text;
  if (byId("who-more").textContent !== more) byId("who-more").textContent = more;
  const swatch = byId("who-colour");
  swatch.hidden = !rider?.policy;
  swatch.style.background = rider?.policy ? colour(rider) : "";
  box.title = rider?.policy ? `policy ${rider.policy}` : "";
}
