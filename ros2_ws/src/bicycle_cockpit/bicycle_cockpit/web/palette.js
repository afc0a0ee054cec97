// The colour of each policy, by its number in the palette of the cockpit or of a bag.

import { policyColour, policyStyle } from "./theme.js";

let slots = {};

/** Takes the cockpit's palette. */
export function usePalette(all) {
  slots = all;
}

/** Adds the policies of a bag. */
export function addToPalette(policies) {
  for (const { colour, slot } of policies) slots = { ...slots, [colour]: slot };
}

export const colourOf = (rider) => policyColour(slots[rider.colour]);

/** The same for an element's style. */
export const styleOf = (rider) => policyStyle(slots[rider.colour]);
