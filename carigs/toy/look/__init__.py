"""The appearance of the toy subject: skin, hair, teeth, light and the renderer."""
