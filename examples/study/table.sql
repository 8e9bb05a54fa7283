SELECT condition.value AS "condition", pair.value AS pair, e.episode, s.player,
       e.reason AS outcome, e.steps, s.acted, s.busy, s.idle, s.waiting, s.away,
       s.rejected AS rejections, s.said AS chat, d.decision_ms
FROM episodes e
JOIN seats s ON s.episode_id = e.id
JOIN labels condition ON condition.episode_id = e.id AND condition.name = 'condition'
JOIN labels pair ON pair.episode_id = e.id AND pair.name = 'pair'
LEFT JOIN (
    SELECT episode_id, seat, round(avg(ms)) AS decision_ms
    FROM steps WHERE activity = 'acted' GROUP BY episode_id, seat
) d ON d.episode_id = e.id AND d.seat = s.seat
ORDER BY condition.value, pair.value, s.seat
