"""One module per rule of the workflow: read the inputs, call the method, write the outputs."""
