"""What raw samples show before anything is known of angle or model; used by `ingest` (check) and by `align`.

edges, levels                 digital and Hall sensors: half height, sub-sample
inductive                     coils: zero crossings; `find_pulses` of any pick-up
damage                        samples that are missing, clipped, isolated or stand still: one rule each
logger_time                   sample number -> time on the logger's clock, where the file's time jumps
marks                         triggers that do not give one pulse per turn of the cam
running                       running median and maximum
"""
