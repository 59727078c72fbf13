"""A player on the session bus with what `examples/media_control.py` uses of MPRIS; prints what it was told, until killed."""

from jeepney import message_bus, new_error, new_method_return
from jeepney.io.blocking import Proxy, open_dbus_connection

NAME = "org.mpris.MediaPlayer2.test"


def main():
    """Answer calls."""
    connection, volume = open_dbus_connection(bus="SESSION"), 0.5
    Proxy(message_bus, connection).RequestName(NAME)
    print("ready", flush=True)
    while True:
        message = connection.receive()
        fields = {key.name: value for key, value in message.header.fields.items()}
        member, interface = fields.get("member"), fields.get("interface")
        if message.header.message_type.name != "method_call":
            continue
        if interface == "org.mpris.MediaPlayer2.Player" and member in ("PlayPause", "Next", "Previous"):
            print(member, flush=True)
            answer = new_method_return(message)
        elif interface == "org.freedesktop.DBus.Properties" and message.body[:2] == ("org.mpris.MediaPlayer2.Player", "Volume"):
            if member == "Set":
                volume = message.body[2][1]
                print(f"Volume {volume:.1f}", flush=True)
                answer = new_method_return(message)
            else:
                answer = new_method_return(message, "v", (("d", volume),))
        else:
            answer = new_error(message, "org.freedesktop.DBus.Error.UnknownMethod", "s", (str(member),))
        connection.send(answer)


if __name__ == "__main__":
    main()
