// Runs jobs of a test, given as JSON on standard input, and prints their results as JSON.
import { join } from "node:path";
import { pathToFileURL } from "node:url";
import { run } from "./jobs.mjs";

const walkers = await import(pathToFileURL(join(process.argv[2], "passive-walker.js")));
const chunks = [];
for await (const chunk of process.stdin) chunks.push(chunk);
const results = [];
for (const job of JSON.parse(Buffer.concat(chunks).toString())) results.push(await run(walkers, job));
process.stdout.write(JSON.stringify(results));
