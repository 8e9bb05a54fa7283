// The nodes of a cluster.

import { Rows, h, number, setAttribute, setText, span } from "./dom.js";

// Address of a node without what all nodes have in common.
export const nodeName = (url) => url.replace(/^wss?:\/\//, "").replace(/\/$/, "");

function marks(row) {
  return [
    row.problem,
    row.leaving ? "leaving" : "",
    row.same_keys ? "" : "signs tokens with other keys",
    row.same_tasks ? "" : "has other tasks",
    row.same_version ? "" : `other version: ${row.version}`,
  ].filter(Boolean);
}

function line() {
  const cells = { node: h("th", { scope: "row" }), seats: h("td"), silent: h("td"), state: h("td") };
  const root = h("tr", {}, ...Object.values(cells));
  return {
    root,
    update(row) {
      const found = marks(row);
      setText(cells.node, nodeName(row.node));
      setAttribute(cells.node, "title", row.operator ? `operator page: ${row.operator}` : "no operator page");
      setText(cells.seats, number(row.seats));
      setText(cells.silent, span(row.silent));
      setText(cells.state, found.length ? found.join(" · ") : "ready");
      setAttribute(cells.state, "class", found.length ? "bad" : "");
    },
  };
}

export class Nodes {
  constructor(root) {
    this.root = root;
    const body = h("tbody");
    const titles = ["Node", "Seats in use", "Last report", "State"];
    root.append(h("table", {}, h("thead", {}, h("tr", {}, ...titles.map((title) => h("th", { scope: "col" }, title)))), body));
    this.rows = new Rows(body, (row) => row.node, line);
  }

  update({ nodes }) {
    this.root.hidden = nodes.length === 0;
    this.rows.update(nodes);
  }
}
