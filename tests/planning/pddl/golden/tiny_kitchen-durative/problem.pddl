(define (problem tiny_kitchen)
  (:domain robotouille)
  (:objects
    stove1 - station
    table1 - station
    patty1 - item
    robot1 - player
    water1 - meal
    water2 - meal
    n2 - count
    n3 - count
  )
  (:init
    (= (cook-0-lasts-1 patty1) 2)
    (= (fry-0-lasts-1 patty1) 4)
    (= (boil-water-0-lasts-1 water1) 4)
    (= (boil-water-0-lasts-1 water2) 4)
    (free robot1)
    (clear patty1)
    (iscookable patty1)
    (ispatty patty1)
    (isrobot robot1)
    (isstove stove1)
    (istable table1)
    (item_at patty1 table1)
    (item_on patty1 table1)
    (loc robot1 table1)
    (nothing robot1)
    (station_empty stove1)
    (vacant stove1)
    (next-water water1)
    (follows-water water1 water2)
    (quiet)
    (next n0 n1)
    (next n1 n2)
    (next n2 n3)
    (goal-1 patty1)
    (goal-2 table1)
    (cut-0-last-0 patty1 n2)
  )
  (:goal (done))
  (:metric minimize (total-time))
)
