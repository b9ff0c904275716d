"""Many recordings: the flow of `run` mapped over workers, everything finished remembered, then one joint fit.

find       recordings at or below a folder, links followed
store      the folder of one recording's result: written whole, remembered, read back
task       one recording: the hash of what its result depends on, and the unit of work, done in a worker
cluster    Dask: a running scheduler, jobs of a batch system (on this machine: camtorque.process.workers)
flow       all of them, one after the other, the joint fit where they allow it, and the index
"""

from camtorque.campaign.flow import CampaignOptions, list_recordings, prune, run_campaign, run_only
