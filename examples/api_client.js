// Moves the arm of a running console: node examples/api_client.js 'http://localhost:8080/?token=…'
// Node 22 or newer, or `npm install ws` with an older one. Press Ctrl-C: the arm stops with its client.
const link = new URL(process.argv[2]);
const Socket = globalThis.WebSocket ?? require("ws");
const socket = new Socket(`ws${link.protocol === "https:" ? "s" : ""}://${link.host}/api${link.search}`);
const waiting = new Map();
let number = 0;
let arm = null; // the newest snapshot

const say = (record) => socket.send(JSON.stringify(record));

function ask(command) {
  number += 1;
  say({ type: "ask", id: number, command });
  return new Promise((done, failed) => waiting.set(number, { done, failed }));
}

async function main() {
  await ask({ command: "take-control" });
  if (arm.board === null) await ask({ command: "connect", port: "sim" });
  if (arm.state === "off") await ask({ command: "enable" });
  await ask({ command: "move-to", target: { point: [0.2, 0.05, 0.1] } }); // metres
  console.log("at", arm.q_command.map((angle) => ((180 / Math.PI) * angle).toFixed(2)).join(" "));
  await ask({ command: "move-joints", q: arm.q_command.map((angle, k) => (k === 0 ? 0 : angle)) }); // radians
  console.log(arm.state);
}

socket.onopen = () => say({ type: "hello", name: "javascript" });
socket.onerror = (event) => fail(event.message ?? "no console answers there");
socket.onclose = (event) => fail(`closed ${event.code}`);
let begun = false;
socket.onmessage = ({ data }) => {
  const record = JSON.parse(data);
  if (record.type === "seen") {
    arm = record.snapshot;
    if (!begun) {
      begun = true;
      main().then(() => process.exit(0), (error) => fail(error.message));
    }
  } else if (record.type === "answer" && record.finished) {
    const { done, failed } = waiting.get(record.id);
    waiting.delete(record.id);
    if (record.error) failed(new Error(record.error));
    else done();
  } else if (record.type === "refused") fail(record.error);
};

function fail(text) {
  console.error(text);
  process.exit(1);
}
