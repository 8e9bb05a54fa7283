SELECT c.value AS "condition", p.value AS pair, s.episode, s.player,
       s.reason AS outcome, s.steps, s.acted, s.busy, s.unused, s.hindered, s.waits, s.away,
       s.rejected AS rejections, s.said AS chat, round(s.decision_ms) AS decision_ms
FROM episode_seats s
JOIN labels c ON c.episode_id = s.episode_id AND c.name = 'condition'
JOIN labels p ON p.episode_id = s.episode_id AND p.name = 'pair'
ORDER BY c.value, p.value, s.seat
