; tiny_lamps@1, durative encoding: delays do not pause. See docs/planners.md.
(define (domain lamps)
  (:requirements :strips :typing :negative-preconditions :equality :conditional-effects :durative-actions :fluents)
  (:types
    seat - object
    spot - object
    lamp - object
    keeper - seat
    count - object
  )
  (:constants
    n0 - count
    n1 - count
  )
  (:predicates
    (at-2 ?x0 - keeper ?x1 - spot)
    (hangs ?x0 - lamp ?x1 - spot)
    (shines ?x0 - lamp)
    (light-0-active ?x0 - lamp)
    (goal-1 ?x0 - lamp)
    (light-0-running ?x0 - lamp)
    (free ?x0 - seat)
    (next ?x0 - count ?x1 - count)
    (done)
  )
  (:functions
    (light-0-lasts-0 ?x0 - lamp) - number
  )
  (:durative-action light
    :parameters (?k - keeper ?l - lamp ?s - spot)
    :duration (= ?duration 1)
    :condition (and
      (at start (free ?k))
      (at start (at-2 ?k ?s))
      (at start (hangs ?l ?s))
      (at start (not (shines ?l)))
    )
    :effect (and
      (at start (not (free ?k)))
      (when (at start (not (light-0-active ?l))) (at start (light-0-active ?l)))
      (at end (free ?k))
    )
  )
  (:durative-action delay-light-0-0
    :parameters (?l - lamp)
    :duration (= ?duration (light-0-lasts-0 ?l))
    :condition (and
      (at start (light-0-active ?l))
      (at start (not (light-0-running ?l)))
    )
    :effect (and
      (at start (light-0-running ?l))
      (and (at end (not (light-0-running ?l))) (at end (not (light-0-active ?l))) (at end (shines ?l)))
    )
  )
  (:action finish
    :parameters (?g1 - lamp)
    :precondition (and
      (shines ?g1)
      (goal-1 ?g1)
    )
    :effect (and
      (done)
    )
  )
)
