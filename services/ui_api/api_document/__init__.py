"""The OpenAPI document: what the framework writes of the routes, and what it cannot know."""
