// Rules that the type checker does not have. `node_modules` of this folder has the program.

/** Properties that turn texts into markup: names and chat come from strangers. */
const MARKUP = ["innerHTML", "outerHTML", "insertAdjacentHTML", "write", "srcdoc", "cssText"];

export default [
  {
    files: ["**/*.js", "**/*.mjs"],
    linterOptions: { reportUnusedDisableDirectives: "error" },
    rules: {
      "array-callback-return": "error",
      curly: ["error", "multi-line"],
      eqeqeq: ["error", "always", { null: "ignore" }],
      "no-eval": "error",
      "no-implied-eval": "error",
      "no-new-func": "error",
      "no-script-url": "error",
      "no-self-assign": "error",
      "no-self-compare": "error",
      "no-template-curly-in-string": "error",
      "no-unsafe-finally": "error",
      "no-unsafe-optional-chaining": "error",
      "no-unused-expressions": ["error", { allowShortCircuit: true, allowTernary: true }],
      "no-unused-vars": "error",
      "no-useless-return": "error",
      "no-var": "error",
      "no-restricted-properties": [
        "error", ...MARKUP.map((property) => ({ property, message: "Set texts, never markup." })),
      ],
      "object-shorthand": "error",
      "prefer-const": ["error", { destructuring: "all" }],
      "require-atomic-updates": "error",
    },
  },
];
