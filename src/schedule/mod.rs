//! TDMA: slots, order of users, transit trajectories.
