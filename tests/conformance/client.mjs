// Does what is asked on standard input, as JSON `{"do": name, ...}`; prints the result as JSON.

import { readFileSync } from "node:fs";

import { conversation, cuts } from "./games.mjs";
import { recording } from "./recording.mjs";
import { closings, compression, fragments, mixups, offers, oversized } from "./sockets.mjs";
import { violations } from "./violations.mjs";

const TASKS = {
  closings, compression, conversation, cuts, fragments, mixups, offers, oversized,
  recording, violations,
};

const { do: name, ...options } = JSON.parse(readFileSync(0, "utf8"));
const result = await TASKS[name](options);
process.stdout.write(JSON.stringify(result), () => process.exit(0));
