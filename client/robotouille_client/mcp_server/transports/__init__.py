"""How clients of the Model Context Protocol reach us: a pipe, or HTTP."""
