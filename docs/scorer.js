// Order of the search's results: first where the title has most words of the query; pages of commands before others,
// and what mentions the words in the Python interface or in a decision last.
var Scorer = {
  score: ([page, title, , , score, , kind]) => {
    const query = new URLSearchParams(window.location.search).get("q") || "";
    const words = query.toLowerCase().split(/\W+/).filter((word) => word.length > 2);
    const inTitle = words.filter((word) => title.toLowerCase().includes(word.slice(0, 6))).length;
    const room = { commands: 10, api: kind === "text" ? -20 : 0, decisions: -20 }[page.split("/")[0]];
    return score + 10 * inTitle + (room || 0);
  },
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
