"""What raw samples show before anything is known of angle or model; used by `ingest` (check) and by `align`.

edges, inductive, edge_time   voltage -> edge times: pulses of a digital or Hall sensor, zero crossings of a coil
damage                        samples that are missing, clipped or stand still
logger_time                   sample number -> time on the logger's clock, where the file's time jumps
running                       running median and maximum
"""
