"""Translate the proxy of QGIS to variables that pip reads; as variables no list of processes shows a password."""

from __future__ import annotations

from urllib.parse import quote, urlsplit

from qgis.core import QgsNetworkAccessManager
from qgis.PyQt.QtNetwork import QNetworkProxy

HTTP = (QNetworkProxy.ProxyType.HttpProxy, QNetworkProxy.ProxyType.HttpCachingProxy)


def proxy_of_qgis() -> tuple[dict[str, str], str]:
    """Return the variables for the proxy in the settings of QGIS, and a line about it.

    Without a proxy there, pip uses that of the system.

    Returns
    -------
    (dict of str to str, str)
    """
    manager = QgsNetworkAccessManager.instance()
    proxy = manager.fallbackProxy()
    if proxy.type() == QNetworkProxy.ProxyType.Socks5Proxy:
        return {}, "the proxy of QGIS is of kind SOCKS, which pip cannot use; the proxy of the system is used"
    if proxy.type() not in HTTP or not proxy.hostName():
        return {}, ""
    made = variables(proxy.hostName(), proxy.port(), proxy.user(), proxy.password(), manager.excludeList())
    return made, f"proxy of QGIS: {proxy.hostName()}:{proxy.port()}"


def variables(host: str, port: int, user: str, password: str, direct: list[str]) -> dict[str, str]:
    """Return the variables for a proxy.

    Parameters
    ----------
    host : str
    port : int
    user, password : str
        "" for none.
    direct : list of str
        Addresses that are reached without it.

    Returns
    -------
    dict of str to str
    """
    login = quote(user, safe="") + (":" + quote(password, safe="") if password else "") + "@" if user else ""
    address = f"http://{login}{host}" + (f":{port}" if port else "")
    made = {"http_proxy": address, "https_proxy": address}
    hosts = [urlsplit(place if "//" in place else f"//{place}").hostname for place in direct]
    return {**made, "no_proxy": ",".join(filter(None, hosts))} if any(hosts) else made
