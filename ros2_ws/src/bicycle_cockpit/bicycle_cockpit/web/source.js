// Where recorded rides come from: the cockpit, or files beside this page where no cockpit runs.

import { token } from "./socket.js";

/** The folder of the rides, where this page shows nothing else; empty where a cockpit serves it. */
export const RIDES = document.querySelector('meta[name="rides"]')?.content ?? "";

async function get(path) {
  const headers = token() ? { Authorization: `Bearer ${token()}` } : {};
  const response = await fetch(path, { headers });
  const kind = response.headers.get("Content-Type") ?? "";
  const data = kind.includes("json") || (RIDES && response.ok) ? await response.json() : {};
  if (!response.ok) throw new Error(data.error ?? `the server answers ${response.status}`);
  return data;
}

/** The rides to choose from, as the cockpit lists bags. */
export const listed = () => get(RIDES ? `${RIDES}/index.json` : "bags");

/** One ride in the page's form; `rider` rides it again in simulation, which needs a cockpit. */
export function loaded(name, rider = "") {
  const path = name.split("/").map(encodeURIComponent).join("/");
  return get(RIDES ? `${RIDES}/${path}.json` : `bags/${path}${rider ? `?rider=${encodeURIComponent(rider)}` : ""}`);
}
