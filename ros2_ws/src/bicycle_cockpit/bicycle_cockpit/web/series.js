// Rows of a ride by column: the live one, which grows, or a whole bag.

const MOST = 24000;
/** s between two rows from which on a line is not drawn through. */
export const GAP = 1;

export class Series {
  /**
   * @param {string[]} columns their names, in the order of every row
   * @param {number} first number of the first row in its ride
   */
  constructor(columns, first = 0) {
    this.columns = columns;
    this.data = columns.map(() => []);
    for (const [index, name] of columns.entries()) this[name] = this.data[index];
    this.first = this.next = first;
  }

  get length() {
    return this.t.length;
  }

  /** Takes in newer rows; those that are there already are left out. */
  push(rows, first) {
    for (const row of rows.slice(Math.max(0, this.next - first))) {
      row.forEach((value, index) => this.data[index].push(value === null ? NaN : value));
    }
    this.next = Math.max(this.next, first + rows.length);
    if (this.length > 1.25 * MOST) {
      const many = this.length - MOST;
      for (const column of this.data) column.splice(0, many);
      this.first += many;
    }
  }

  /** Takes in the rows that come before the first one; whether they did. */
  prepend(rows, first) {
    if (first + rows.length !== this.first) return false;
    this.put(rows[0].map((_, index) => rows.map((row) => (row[index] === null ? NaN : row[index]))), first);
    return true;
  }

  /** Puts columns of rows before the first one. */
  put(columns, first) {
    this.data.forEach((column, index) => {
      const later = column.splice(0, column.length);
      for (const part of [columns[index], later]) for (const value of part) column.push(value);
    });
    this.first = first;
  }

  fill(data) {
    data.forEach((column, index) => {
      this.data[index].length = 0;
      for (const value of column) this.data[index].push(value === null ? NaN : value);
    });
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

  /** Whether a line must not be drawn from the row before: a reset, or rows that are missing. */
  broken(index) {
    return this.episode[index] !== this.episode[index - 1] || this.t[index] - this.t[index - 1] > GAP;
  }

  /** Numbers of the policies that rode in rows from `from` to `to`, in the order they came. */
  policiesIn(from, to) {
    const found = new Set();
    for (let index = Math.max(0, from); index <= to; index++) found.add(this.policy[index]);
    return [...found].filter(Number.isFinite);
  }
}
