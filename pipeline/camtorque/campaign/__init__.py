"""Many recordings: the flow of `run` mapped over workers, everything finished remembered, then one joint fit.

find       recordings at or below a folder, links followed
key        what a result depends on, as one hash: the name of its folder
store      the folder of one recording's result: written whole, remembered, read back
task       one recording: the unit of work, done in a worker
cluster    Dask: a running scheduler, jobs of a batch system (on this machine: camtorque.process.workers)
joint      the joint fit, where the recordings allow it
flow       all of them, one after the other, and the index
"""

from camtorque.campaign.flow import CampaignOptions, list_recordings, prune, run_campaign, run_only
