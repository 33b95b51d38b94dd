"""Many computations of one kind, on every core or on a cluster: cut into units with seeds of their own, kept as they finish, summed up in the end."""
