"""Methods of other people that ours is compared with; the services never import them."""
