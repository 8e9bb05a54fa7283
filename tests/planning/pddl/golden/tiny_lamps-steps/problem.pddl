(define (problem tiny_lamps)
  (:domain lamps)
  (:objects
    wall1 - spot
    oil-lamp1 - lamp
    keeper1 - keeper
    n2 - count
  )
  (:init
    (= (total-cost) 0)
    (turn keeper1)
    (then keeper1 clock)
    (then clock keeper1)
    (at-2 keeper1 wall1)
    (hangs oil-lamp1 wall1)
    (next n0 n1)
    (next n1 n2)
    (light-0-last-0 oil-lamp1 n2)
    (goal-1 oil-lamp1)
  )
  (:goal (done))
  (:metric minimize (total-cost))
)
