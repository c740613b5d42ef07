"""Every environment, for every scene, is as many single environments."""
