"""Many computations of one kind, on every core or on a cluster: cut into units, kept as they finish, summed up in the end."""
