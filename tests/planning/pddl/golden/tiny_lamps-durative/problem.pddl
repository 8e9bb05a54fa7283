(define (problem tiny_lamps)
  (:domain lamps)
  (:objects
    wall1 - spot
    oil-lamp1 - lamp
    keeper1 - keeper
    n2 - count
  )
  (:init
    (= (light-0-lasts-0 oil-lamp1) 3)
    (free keeper1)
    (at-2 keeper1 wall1)
    (hangs oil-lamp1 wall1)
    (next n0 n1)
    (next n1 n2)
    (goal-1 oil-lamp1)
  )
  (:goal (done))
  (:metric minimize (total-time))
)
