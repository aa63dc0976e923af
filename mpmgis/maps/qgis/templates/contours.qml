<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<qgis version="3.22.0" styleCategories="AllStyleCategories">
 <pipe>
  <provider>
   <resampling enabled="true" maxOversampling="2" zoomedInResamplingMethod="cubic" zoomedOutResamplingMethod="bilinear"/>
  </provider>
  <rasterrenderer type="contour" band="1" contour-interval="$interval" contour-index-interval="$index" downscale="4" opacity="0.6" alphaBand="-1" nodataColor="">
   <symbols>
    <symbol type="line" name="contour" alpha="1">
     <layer class="SimpleLine" enabled="1" pass="0" locked="0">
      <Option type="Map">
       <Option type="QString" name="line_color" value="90,70,50,255"/>
       <Option type="QString" name="line_width" value="0.1"/>
       <Option type="QString" name="line_width_unit" value="MM"/>
      </Option>
      <prop k="line_color" v="90,70,50,255"/>
      <prop k="line_width" v="0.1"/>
      <prop k="line_width_unit" v="MM"/>
     </layer>
    </symbol>
    <symbol type="line" name="index" alpha="1">
     <layer class="SimpleLine" enabled="1" pass="0" locked="0">
      <Option type="Map">
       <Option type="QString" name="line_color" value="90,70,50,255"/>
       <Option type="QString" name="line_width" value="0.25"/>
       <Option type="QString" name="line_width_unit" value="MM"/>
      </Option>
      <prop k="line_color" v="90,70,50,255"/>
      <prop k="line_width" v="0.25"/>
      <prop k="line_width_unit" v="MM"/>
     </layer>
    </symbol>
   </symbols>
  </rasterrenderer>
  <resamplingStage>provider</resamplingStage>
 </pipe>
 <blendMode>0</blendMode>
</qgis>
