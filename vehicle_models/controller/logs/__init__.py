"""Flight logs: recorded as compact samples, written as ULog or DataFlash only when a client asks for one."""
