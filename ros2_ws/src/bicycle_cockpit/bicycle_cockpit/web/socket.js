// The WebSocket: comes back by itself, and tells how each request went.

const LONGEST_WAIT = 5000;

export function token() {
  return new URLSearchParams(location.hash.slice(1)).get("token") ?? "";
}

export class Link {
  /**
   * @param {(message: object) => void} onMessage
   * @param {(connected: boolean) => void} onChange
   */
  constructor(onMessage, onChange) {
    this.onMessage = onMessage;
    this.onChange = onChange;
    this.next = 1;
    this.waiting = new Map();
    this.wait = 250;
    this.open();
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const query = token() ? `?token=${encodeURIComponent(token())}` : "";
    this.socket = new WebSocket(`${scheme}://${location.host}/ws${query}`);
    this.socket.onopen = () => {
      this.wait = 250;
      this.onChange(true);
    };
    this.socket.onmessage = ({ data }) => this.take(JSON.parse(data));
    this.socket.onclose = () => {
      for (const answer of this.waiting.values()) answer({ ok: false, message: "the connection was lost" });
      this.waiting.clear();
      this.onChange(false);
      setTimeout(() => this.open(), this.wait);
      this.wait = Math.min(2 * this.wait, LONGEST_WAIT);
    };
  }

  take(message) {
    if (message.type === "answer" && this.waiting.has(message.id)) {
      this.waiting.get(message.id)(message);
      this.waiting.delete(message.id);
    } else {
      this.onMessage(message);
    }
  }

  /** Sends a request; resolves to `{ok, message}`. */
  ask(type, fields = {}) {
    if (this.socket.readyState !== WebSocket.OPEN) {
      return Promise.resolve({ ok: false, message: "not connected to the cockpit" });
    }
    const id = this.next++;
    this.socket.send(JSON.stringify({ type, id, ...fields }));
    return new Promise((resolve) => this.waiting.set(id, resolve));
  }
}
