"""The paper of Saafi, Laribi and Zeghloul (2015), redrawn figure by figure: docs/paper."""
