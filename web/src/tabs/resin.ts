// The tab of the resin: spectra, discs and guides become numbers of a resin, and a resin file.
import { Tab } from "../tab";

class ResinTab extends Tab {
  readonly tab = "resin";

  protected hint(): string {
    return "Drop a spectrum of a layer, a table of cured discs or of guides: the kind is detected automatically.";
  }
}

customElements.define("solen-resin", ResinTab);
