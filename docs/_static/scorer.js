// Order of the results of a search: guides before the appendix, its logs last.
var Scorer = {
  score: ([page, , , , score]) => {
    if (page === "appendix/measurements") return score - 40;
    if (page.startsWith("appendix/")) return score - 20;
    return page === "faq" ? score + 5 : score;
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
