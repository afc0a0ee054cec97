// Rows of a ride by column: the live one, which grows, or a whole bag.

const MOST = 24000;

export class Series {
  /** @param {string[]} columns their names, in the order of every row */
  constructor(columns) {
    this.columns = columns;
    this.data = columns.map(() => []);
    for (const [index, name] of columns.entries()) this[name] = this.data[index];
  }

  get length() {
    return this.t.length;
  }

  /** Takes in rows; when time goes back, the simulator was started anew and what was is gone. */
  push(rows) {
    for (const row of rows) {
      if (this.length && row[0] < this.t[this.length - 1]) this.clear();
      row.forEach((value, index) => this.data[index].push(value === null ? NaN : value));
    }
    if (this.length > 1.25 * MOST) for (const column of this.data) column.splice(0, this.length - MOST);
  }

  fill(data) {
    data.forEach((column, index) => {
      this.data[index].length = 0;
      for (const value of column) this.data[index].push(value === null ? NaN : value);
    });
  }

  clear() {
    for (const column of this.data) column.length = 0;
  }

  /** The last row at or before a time, 0 where all are later, -1 without rows. */
  indexAt(time) {
    let [low, high] = [0, this.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.t[middle] <= time) low = middle + 1;
      else high = middle;
    }
    return Math.max(low - 1, this.length ? 0 : -1);
  }

  /** One row as an object. */
  row(index) {
    return Object.fromEntries(this.columns.map((name, column) => [name, this.data[column][index]]));
  }
}

/** From when on which policy rode, with a colour for each by the order in which they came. */
export class Policies {
  constructor(changes = []) {
    this.changes = [];
    this.names = [];
    for (const { t, name } of changes) this.add(t, name);
  }

  add(t, name) {
    if (!name || name === this.changes.at(-1)?.name) return;
    this.changes.push({ t, name });
    if (!this.names.includes(name)) this.names.push(name);
  }

  colour(name) {
    return `p${Math.max(0, this.names.indexOf(name)) % 6}`;
  }

  at(t) {
    return this.changes.findLast((change) => change.t <= t)?.name ?? this.changes[0]?.name ?? "";
  }
}
