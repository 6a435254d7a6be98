"""The joint fit as a stream: motion that has passed is eliminated, body and calibration go on."""
