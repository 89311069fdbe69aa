"""Work on several processes: a pool of them, and what it does for many grains.

`pool` is the one protocol (a job declares what goes in, what is done, what comes out), `child` what a process
runs, `messages` how the two talk. Begin at :class:`~mbstudio.core.batch.pool.WorkerPool`, or for fits at
:func:`~mbstudio.core.batch.many_fits.fit_many`.
"""
