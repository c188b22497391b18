"""A control loop with slip and margin.

A ball is pressed on a palm and dragged until it slips. The loop reports when incipient slip
begins, and raises the grip command to the force that would hold. Send `command_n` to your gripper
in place of the list.
"""

import matplotlib.pyplot as plt

import skin

settings = skin.SlipSettings(safety=1.2, friction=0.3)  # friction is believed until a slip shows it
command_n, log = 2.0, []

with skin.open("palm", simulate="slide", slip=settings, pace=False) as palm:
    for state in palm:
        for contact in state.contacts:
            if contact.onset_s == 0.0 and contact.load > 1.0:  # began to slip in this cycle
                print(
                    f"{contact.age_s:.2f} s: contact {contact.id} {contact.slip.name}, "
                    f"friction {contact.friction:.2f}, needs {contact.grip_force:.1f} N"
                )
            if contact.slip >= skin.SlipState.INCIPIENT and contact.grip_force > command_n:
                command_n = float(contact.grip_force)
            log.append((contact.age_s, contact.load, contact.shear, contact.margin))
        if state.cycle >= 1800:
            break

print(f"grip command {command_n:.1f} N")
age_s, load, shear, margin = zip(*log, strict=True)
figure, (forces, margins) = plt.subplots(2, sharex=True, layout="constrained")
forces.plot(age_s, load, label="normal load, N")
forces.plot(age_s, shear, label="shear, N")
forces.legend()
margins.plot(age_s, margin, color="tab:red")
margins.axhline(0.0, color="gray", linewidth=0.5)
margins.set(xlabel="seconds since the touch", ylabel="margin")
figure.savefig("slip_margin.png", dpi=100)
