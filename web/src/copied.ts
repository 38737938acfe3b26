// Text that a person copies: a command line, a script.
import { html, type TemplateResult } from "lit";

export function copied(name: string, text: string): TemplateResult {
  return html`<p>${name} <button type="button" @click=${() => navigator.clipboard.writeText(text)}>Copy</button></p>
    <pre tabindex="0">${text}</pre>`;
}

export function give(blob: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
