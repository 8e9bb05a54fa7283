; tiny_lamps@1, step encoding: a plan's cost is its number of steps.
; See docs/planners.md.
(define (domain lamps)
  (:requirements :strips :typing :negative-preconditions :equality :conditional-effects :action-costs)
  (:types
    actor - object
    seat - actor
    spot - object
    lamp - object
    keeper - seat
    count - object
  )
  (:constants
    clock - actor
    n0 - count
    n1 - count
  )
  (:predicates
    (at-2 ?x0 - keeper ?x1 - spot)
    (hangs ?x0 - lamp ?x1 - spot)
    (shines ?x0 - lamp)
    (light-0-active ?x0 - lamp)
    (light-0-count-0 ?x0 - lamp ?x1 - count)
    (light-0-last-0 ?x0 - lamp ?x1 - count)
    (goal-1 ?x0 - lamp)
    (turn ?x0 - actor)
    (then ?x0 - actor ?x1 - actor)
    (next ?x0 - count ?x1 - count)
    (done)
  )
  (:functions
    (total-cost) - number
  )
  (:action light
    :parameters (?k - keeper ?l - lamp ?s - spot ?next - actor)
    :precondition (and
      (turn ?k)
      (then ?k ?next)
      (at-2 ?k ?s)
      (hangs ?l ?s)
      (not (shines ?l))
    )
    :effect (and
      (and (not (turn ?k)) (turn ?next))
      (when (not (light-0-active ?l)) (and (light-0-active ?l) (light-0-count-0 ?l n0)))
    )
  )
  (:action pass
    :parameters (?seat - seat ?next - actor)
    :precondition (and
      (turn ?seat)
      (then ?seat ?next)
    )
    :effect (and
      (and (not (turn ?seat)) (turn ?next))
    )
  )
  (:action tick
    :parameters (?first - seat)
    :precondition (and
      (turn clock)
      (then clock ?first)
    )
    :effect (and
      (and (not (turn clock)) (turn ?first))
      (forall (?l - lamp ?n0 - count) (when (and (light-0-active ?l) (light-0-count-0 ?l ?n0) (light-0-last-0 ?l ?n0)) (and (not (light-0-count-0 ?l ?n0)) (shines ?l) (not (light-0-active ?l)))))
      (forall (?l - lamp ?n0 - count ?m0 - count) (when (and (light-0-active ?l) (light-0-count-0 ?l ?n0) (next ?n0 ?m0) (not (light-0-last-0 ?l ?n0))) (and (not (light-0-count-0 ?l ?n0)) (light-0-count-0 ?l ?m0))))
      (increase (total-cost) 1)
    )
  )
  (:action finish
    :parameters (?first - seat ?g1 - lamp)
    :precondition (and
      (turn ?first)
      (then clock ?first)
      (shines ?g1)
      (goal-1 ?g1)
    )
    :effect (and
      (done)
    )
  )
)
