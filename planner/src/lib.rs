//! Whom to serve and where to fly: the strategies and their waypoint solvers.
