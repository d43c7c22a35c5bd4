"""What joins both adapters: recordings played to live nodes, and live topics recorded."""
