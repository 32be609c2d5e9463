"""Studies of the paper of Behzadinasab & Foster: closed forms, figures and claims."""
