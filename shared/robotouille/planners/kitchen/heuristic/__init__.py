"""A lower bound of the steps to the goal of a kitchen: `lower_bound` is the whole, the rest parts.

A worked example. One cook, who stands at the bread; on the only board lies cheese, on the second
table lettuce under a tomato; two tables are free; cutting takes two performances. Wanted: the
lettuce cut and on the bread, the cheese on the lettuce.

    board1    table2     table3     table4    table5
    cheese    bread      tomato     -         -
              (cook)     lettuce

*Items.* The bread is in place: 0. The lettuce has a stop at the board and then has to get onto the
bread, two deliveries of 3 steps; 2 cuts; and a walk to it: 9. The cheese is not in place: one
delivery and a walk, 4.

*Obstacles.* The lettuce leaves, so what is on it has to go first: the tomato, a delivery and a
walk, 4. (It need not be put where something else is, and no goal speaks of it.) The board is taken,
but by the cheese, which leaves anyway: 0.

*Cycles.* The cheese leaves the board before the lettuce gets there (the only board), the lettuce
gets there before it gets onto the bread, and that before the cheese gets onto it. So cheese's only
delivery and lettuce's two are on a cycle, and one of them is interrupted by a stop: 4.

*Work* is 0 + 9 + 4 + 4 + 4 = 21.

*Chain.* The lettuce needs 6 + 2 + 1 = 9 steps, and then somebody has to fetch and place the cheese:
4 more, 13. The cheese's own chain is 4, and the tomato has no place to get to: none.

The heuristic is max(21, 13) = 21, and the shortest plan has 21 steps: cheese to table4 (4), tomato
to table5 (4), lettuce to the board (4), two cuts (2), lettuce onto the bread (3), cheese onto the
lettuce (4).

Were there two cooks, the sum would have no stop in it (another's hand may hold the cheese) and be
shared: 17 / 2, rounded up 9. The chain, with 2 steps instead of 4 to place the cheese, would be
larger: 11.
"""
