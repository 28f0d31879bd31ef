"""A laboratory's own bus: what a campaign tells an MQTT broker, and the word of a test stand that it waits for.

from bench.laboratory import open_bus, parse_broker
with open_bus(parse_broker("mqtts://rig@broker.lab:8883/bay-2", password), campaign.name, warn=print) as bus:
    run_campaign_sync(campaign, folder, collaborators=Collaborators([bus.notify]))
"""

from __future__ import annotations

from ._broker import Broker as Broker
from ._broker import parse_broker as parse_broker
from ._bus import LaboratoryBus as LaboratoryBus
from ._bus import Stand as Stand
from ._bus import open_bus as open_bus
from ._documents import CampaignMessage as CampaignMessage
from ._documents import CampaignStatus as CampaignStatus
from ._documents import StandMessage as StandMessage
from ._documents import message_of as message_of
