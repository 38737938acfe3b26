// Work in the background: how far it is, and its end.
import { html, nothing, type TemplateResult } from "lit";

export interface Job {
  number: number;
  name: string;
  state: "running" | "done" | "cancelled" | "failed";
  share: number;
  shell: string;
  folder: string;
  why?: string;
}

export class Refused extends Error {}

// What the server answers as JSON; `Refused` with its line where it refuses.
export async function asked(address: string, method = "GET", body?: BodyInit): Promise<unknown> {
  let answer: Response;
  try {
    answer = await fetch(address, { method, body });
  } catch {
    throw new Refused("Not connected: the studio has ended or cannot be reached.");
  }
  const found = answer.headers.get("content-type") === "application/json" ? await answer.json() : null;
  if (!answer.ok) throw new Refused(found?.what ?? `The studio rejected this (${answer.status}).`);
  return found;
}

export const cancel = (job: Job) => void asked(`jobs/${job.number}`, "DELETE").catch(() => undefined);

export function bar(job: Job, what: string): TemplateResult {
  const known = job.share > 0 || job.state !== "running";
  return html`<div class="progress"><progress max="1" value=${known ? job.share : nothing} aria-label="Completed fraction of ${what}"></progress>
    <output>${known ? `${Math.floor(100 * job.share)} %` : ""}</output>
    <button type="button" ?disabled=${job.state !== "running"} @click=${() => cancel(job)}>Cancel</button></div>`;
}
